"""What a learned policy sees of a state: robot, objects and goal, as the robot faces them.

Places and directions are in the heading frame: at the base, x the way it faces, z up. So a policy
that has learnt to push north can push east. It sees no shapes, masses or friction.
"""

from collections.abc import Callable, Mapping
from functools import partial

import mujoco
import numpy as np

from sumo_dist.costs.parameters import Parameters
from sumo_dist.math.rotations import rotate
from sumo_dist.model.index import StateIndex
from sumo_dist.tasks.task import Task, place_of

Turn = Callable[[np.ndarray], np.ndarray]
"""World vectors (B, 3) -> the same in the heading frame."""

SPEED_UNIT = 10.0  # of joints [rad/s]: what they commonly reach becomes about 1


class Observer:
    """Turns states of a task's model into a policy's inputs; a row's depend on that row alone.

    Attributes:
        parts: name and length of each part of the inputs, in their order. Tasks whose parts are
            equal can be done by the same policy.
    """

    def __init__(self, task: Task, model: mujoco.MjModel) -> None:
        """Find robot, objects and goal in the states of a compiled model."""
        index, robot = StateIndex(model), task.scene.robot
        self._index, self._base = index, robot.base
        self._goal_object, self._goal_place = task.goal_object, partial(place_of, task.goal)
        self._joints, self._speeds = index.joints(robot.joints)
        self._stand = np.array(robot.stand)
        self._objects = tuple(b for b in index.free_bodies if b != robot.base)
        self._hinges, self._slides = _others(index, model, robot.joints)
        self._goal_point = _goal_point(task, model) if task.goal_object else None
        joints = len(robot.joints)
        self.parts: Mapping[str, int] = {
            "base": 10,
            "joints": joints,
            "joint speeds": joints,
            **{f"object {i}": 15 for i in range(len(self._objects))},
            **({"hinges": 3 * len(self._hinges)} if len(self._hinges) else {}),
            **({"slides": 2 * len(self._slides)} if len(self._slides) else {}),
            "goal": 4,
        }

    @property
    def size(self) -> int:
        """Number of inputs."""
        return sum(self.parts.values())

    def __call__(self, states: np.ndarray, parameters: Parameters) -> np.ndarray:
        """Return the inputs (B, size), float32, of states (B, nq + nv).

        Args:
            states: of the model.
            parameters: the task's.
        """
        pose, velocity = states[:, self._index.pose(self._base)], self._velocity(states, self._base)
        position, quat = pose[:, :3], pose[:, 3:]
        forward = rotate(quat, np.array([1.0, 0.0, 0.0]))
        heading = np.arctan2(forward[:, 1], forward[:, 0])

        def seen(vectors: np.ndarray) -> np.ndarray:
            """World vectors (B, 3) in the heading frame."""
            cos, sin = np.cos(heading), np.sin(heading)
            x, y = vectors[:, 0], vectors[:, 1]
            return np.stack([cos * x + sin * y, cos * y - sin * x, vectors[:, 2]], axis=1)

        up = seen(rotate(quat, np.array([0.0, 0.0, 1.0])))
        columns = [position[:, 2:], up, seen(velocity[:, :3]), velocity[:, 3:]]
        columns += [states[:, self._joints] - self._stand, states[:, self._speeds] / SPEED_UNIT]
        for name in self._objects:
            place, speed = states[:, self._index.pose(name)], self._velocity(states, name)
            columns.append(seen(place[:, :3] - position))
            columns += [seen(rotate(place[:, 3:], axis)) for axis in np.eye(3)[[0, 2]]]
            columns += [seen(speed[:, :3]), seen(rotate(place[:, 3:], speed[:, 3:]))]
        angles, turning = states[:, self._hinges[:, 0]], states[:, self._hinges[:, 1]]
        columns += [np.cos(angles), np.sin(angles), turning / SPEED_UNIT]
        columns += [states[:, self._slides[:, 0]], states[:, self._slides[:, 1]]]
        columns.append(self._goal(states, parameters, seen))
        return np.concatenate(columns, axis=1).astype(np.float32)

    def _velocity(self, states: np.ndarray, body: str) -> np.ndarray:
        return states[:, self._index.velocity(body)]

    def _goal(self, states: np.ndarray, parameters: Parameters, seen: Turn) -> np.ndarray:
        """Way of the object to its goal in the heading frame, and 1; zeros where it has none."""
        if self._goal_point is None:
            return np.zeros((len(states), 4))
        goal = self._goal_place(parameters)
        pose = states[:, self._index.pose(self._goal_object)]
        point = pose[:, :3] + rotate(pose[:, 3:], self._goal_point)
        return np.concatenate([seen(goal - point), np.ones((len(states), 1))], axis=1)


def _others(
    index: StateIndex, model: mujoco.MjModel, robot: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Where hinges and slides that are not the robot's lie in a state, (H, 2) and (S, 2)."""
    found: dict[int, list[tuple[int, int]]] = {}
    for name, columns in index.columns.items():
        if name not in robot:
            found.setdefault(int(model.joint(name).type[0]), []).append(columns)
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    hinges, slides = (np.array(found.get(int(kind), []), np.intp).reshape(-1, 2) for kind in kinds)
    return hinges, slides


def _goal_point(task: Task, model: mujoco.MjModel) -> np.ndarray:
    """Where the frame that should come to the goal is, from its object's origin, (3,) [m]."""
    data, frame = mujoco.MjData(model), task.frames[task.goal_frame]
    mujoco.mj_kinematics(model, data)
    body = data.body(task.goal_object)
    place = (data.site if frame.kind == "site" else data.body)(frame.name).xpos
    return body.xmat.reshape(3, 3).T @ (place - body.xpos)
