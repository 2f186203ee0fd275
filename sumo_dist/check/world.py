"""A task's scene without its robot: does what is put there stay where it is put."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.math.rotations import conjugate, multiply
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import Scene
from sumo_dist.model.settle import LOST, why_it_falls, without_robot
from sumo_dist.tasks.reset import REST_SPEED

WATCHED_S = 2.0  # for so long everything must stay
PUSH = 0.01  # turn about x and y that tips over what is balanced on a point [rad/s]
SINK, SLIDE, TURN = 0.01, 0.05, 10.0  # by so much it may drop or rise, slide [m] and turn [deg]


@dataclass(frozen=True)
class Rest:
    """What came of a scene that was left alone.

    Attributes:
        state: (nq + nv,) of the whole scene at the end, everything at rest and the robot as it was.
        moved: what did not stay, one line; "" if all did.
    """

    state: np.ndarray
    moved: str


class World:
    """The objects and fixtures of a scene, alone."""

    def __init__(self, scene: Scene, plant: mujoco.MjModel) -> None:
        """Compile it; states are those of the plant, which has the robot."""
        self._plant, self._model = plant, without_robot(scene)
        self._data = mujoco.MjData(self._model)
        self._index = StateIndex(self._model)
        self.objects = self._index.free_bodies

    def moves(self, state: np.ndarray, body: str) -> bool:
        """Whether an object is in motion at a state: a task may throw it or let it roll."""
        return bool(np.linalg.norm(state[StateIndex(self._plant).velocity(body)]) > REST_SPEED)

    def settle(self, state: np.ndarray) -> Rest:
        """Let a scene alone for a while and say what did not stay."""
        if not len(self.objects):
            return Rest(state, "")
        data, nq = self._data, self._plant.nq
        mujoco.mj_resetData(self._model, data)
        data.qpos[:] = state[nq - self._model.nq : nq]  # the robot comes first
        data.qvel[:] = state[len(state) - self._model.nv :]
        for body in self.objects:
            start = self._index.velocity(body).start - self._index.nq
            data.qvel[start + 3 : start + 5] += PUSH
        before = data.qpos.copy()
        mujoco.mj_step(self._model, data, round(WATCHED_S / self._model.opt.timestep))
        lines = [
            reason
            for body in self.objects
            if not self.moves(state, body) and (reason := self._moved(body, before, data.qpos))
        ]
        end = state.copy()
        end[nq - self._model.nq : nq] = data.qpos
        end[nq:] = 0.0
        return Rest(end, "; ".join(lines))

    def _moved(self, body: str, before: np.ndarray, after: np.ndarray) -> str:
        """Say how an object has moved, "" if it stayed."""
        pose = self._index.pose(body)
        shift = after[pose][:3] - before[pose][:3]
        away, up = float(np.linalg.norm(shift[:2])), float(shift[2])
        cosine = abs(multiply(conjugate(before[pose][3:]), after[pose][3:])[0])
        turn = float(np.degrees(2.0 * np.arccos(min(1.0, cosine))))
        if not np.isfinite(shift).all():
            return f"{body} moves without bounds"
        if up < -LOST:
            return f"{body} falls for ever: {why_it_falls(self._model, body)}"
        if up < -SINK:
            return f"{body} drops by {-up * 1e3:.0f} mm before it rests: it is put too high"
        if up > SINK:
            return f"{body} rises by {up * 1e3:.0f} mm: it is put into what it stands on"
        if away > SLIDE:
            return f"{body} slides or rolls {away * 1e3:.0f} mm in {WATCHED_S:g} s"
        return f"{body} tips by {turn:.0f} deg in {WATCHED_S:g} s" if turn > TURN else ""
