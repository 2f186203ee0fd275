"""Drawing start states: a settled stance, a pose for the robot, a pose for the object."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.errors import SumoError
from sumo_dist.model.index import StateIndex


@dataclass(frozen=True)
class Start:
    """What a reset draws from and writes into.

    Attributes:
        model: the plant's model.
        index: named access to its state.
        stance: (nq_robot,) qpos of the settled robot at the origin, yaw 0.
        base: the robot's free body.
    """

    model: mujoco.MjModel
    index: StateIndex
    stance: np.ndarray
    base: str

    def place(
        self, robot_xy: np.ndarray, yaw: float, objects: dict[str, tuple[np.ndarray, np.ndarray]]
    ) -> np.ndarray:
        """State (nq + nv,) at rest with the robot at xy, yaw and objects at (pos, quat wxyz)."""
        qpos, qvel = self.model.qpos0.copy(), np.zeros(self.model.nv)
        qpos[: len(self.stance)] = self.stance
        pose = self.index.pose(self.base)
        qpos[pose][:2] = robot_xy
        qpos[pose][3:] = [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]
        for name, (pos, quat) in objects.items():
            qpos[self.index.pose(name)] = np.concatenate([pos, quat])
        return np.concatenate([qpos, qvel])

    def touching(self, state: np.ndarray, name: str) -> bool:
        """Whether the robot and the object's subtree are in contact (or overlap) at a state."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = state[: self.model.nq]
        mujoco.mj_forward(self.model, data)
        roots = self.model.body_rootid[self.model.geom_bodyid[data.contact.geom]]
        pair = {self.model.body(self.base).id, self.model.body(name).id}
        return any(set(row) == pair for row in roots)


def redraw(
    draw: Callable[[], np.ndarray], accept: Callable[[np.ndarray], bool], tries: int = 1000
) -> np.ndarray:
    """Draw until accepted; a reset that cannot be reached is an error, not a hang."""
    for _ in range(tries):
        state = draw()
        if accept(state):
            return state
    raise SumoError(f"no acceptable reset in {tries} draws")
