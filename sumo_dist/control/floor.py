"""The floor plan: what a robot's world looks like from above."""

from typing import Any

import mujoco
import numpy as np

from sumo_dist.model.index import StateIndex, label
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.model.visible import drawn
from sumo_dist.tasks.task import Task

MILLIMETRES = 3  # decimals of what is sent [m]
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


class FloorPlan:
    """Outlines of a task's bodies from above: each geom's box, projected.

    Attributes:
        frames: what the places of `places` are called, "base" first.
    """

    def __init__(self, task: Task) -> None:
        """Compile the task's scene."""
        model = compile_model(task.scene, PLANT)
        self._model, self._data = model, mujoco.MjData(model)
        self._index = StateIndex(model)
        self._robot = int(model.body_rootid[model.body(task.scene.robot.base).id])
        kinds = model.geom_type
        flat = (kinds == mujoco.mjtGeom.mjGEOM_PLANE) | (kinds == mujoco.mjtGeom.mjGEOM_HFIELD)
        seen = np.flatnonzero(drawn(model) & ~flat)
        still = model.body_weldid[model.geom_bodyid[seen]] == 0
        self._still, self._moving = seen[still], seen[~still]
        bases = [b for b in range(1, model.nbody) if _is_free(model, b)]
        self._bodies = sorted(bases, key=lambda b: model.body_rootid[b] != self._robot)
        self.frames = [
            "base" if model.body_rootid[b] == self._robot else label(model, "body", b)
            for b in self._bodies
        ]
        mujoco.mj_kinematics(model, self._data)
        self.fixed = self._outlines(self._still)

    def at(self, state: np.ndarray) -> dict[str, Any]:
        """Return what moves as JSON has it.

        Args:
            state: (nq + nv,).

        Returns:
            "shapes": of robot and things: [whose, [[x, y], ...]], whose "robot" or "thing"; and
            "places": [x, y, heading] of each of `frames`; [m], [rad].

        Raises:
            UsageError: the state is of another size.
        """
        self._data.qpos[:] = self._index.unpack(state)[0]
        mujoco.mj_kinematics(self._model, self._data)
        return {
            "shapes": self._outlines(self._moving),
            "places": list(map(self._place, self._bodies)),
        }

    def _place(self, body: int) -> list[float]:
        x, y = self._data.xpos[body][:2]
        rotation = self._data.xmat[body].reshape(3, 3)
        numbers = x, y, np.arctan2(rotation[1, 0], rotation[0, 0])
        return [round(float(n), MILLIMETRES) for n in numbers]

    def _outlines(self, geoms: np.ndarray) -> list[list[Any]]:
        model, data = self._model, self._data
        centres, halves = model.geom_aabb[geoms, :3], model.geom_aabb[geoms, 3:]
        corners = centres[:, None] + halves[:, None] * _CORNERS  # (G, 8, 3), of each geom's frame
        turned = np.einsum("gij,gkj->gki", data.geom_xmat[geoms].reshape(-1, 3, 3), corners)
        seen = np.round((turned + data.geom_xpos[geoms, None])[..., :2], MILLIMETRES)
        roots = model.body_rootid[model.geom_bodyid[geoms]]
        whose = ["robot" if root == self._robot else "thing" for root in roots]
        return [[who, hull(points.tolist())] for who, points in zip(whose, seen, strict=True)]


def hull(points: list[list[float]]) -> list[list[float]]:
    """Return the corners of the convex hull of points (x, y), counter-clockwise."""
    ordered = sorted(points)
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return lower[:-1] + upper[:-1] or ordered[:1]


def _chain(points: list[list[float]]) -> list[list[float]]:
    """One side of the hull of points in order (Andrew's monotone chain)."""
    side: list[list[float]] = []
    for x, y in points:
        while len(side) > 1:
            (ax, ay), (bx, by) = side[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            side.pop()
        side.append([x, y])
    return side


def _is_free(model: mujoco.MjModel, body: int) -> bool:
    joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
    return any(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE for joint in joints)
