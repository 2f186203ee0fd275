"""Drawing start states: a settled stance, a pose for the robot, a pose for the object."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from sumo_dist.costs.view import View, ViewLayout
from sumo_dist.errors import SumoError
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, Scene, build_spec, compile_model
from sumo_dist.model.settle import height_above_floor, settled_stand

CLEARANCE = 1.0  # robot to object at the start of a move, centre to centre [m]
AWAY = 0.5  # object to goal at the start of a move, so that none starts nearly solved [m]
DROP_HEIGHT = 0.02  # of the object's lowest point above the floor [m]
DROP_TIME = 3.0  # a dropped object has come to rest by then, but for what rolls [s]
STOPS, STOP_TIME = 5, 0.2  # what rolls is stopped so often, and let go for so long [s]
REST_SPEED = 0.1  # what counts as rest, all six velocities together [m/s, rad/s]

RobotDraw = Callable[[np.random.Generator], tuple[np.ndarray, float]]
"""rng -> the robot's xy (2,) [m] and yaw [rad]."""


@dataclass(frozen=True)
class Start:
    """What a reset draws from and writes into.

    Attributes:
        scene: the task's.
        model: the plant's model of it.
        index: named access to its state.
        stance: (nq_robot,) qpos of the settled robot at the origin, yaw 0.
    """

    scene: Scene
    model: mujoco.MjModel
    index: StateIndex
    stance: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Compile a scene and settle its robot."""
        model = compile_model(scene, PLANT)
        return cls(scene, model, StateIndex(model), settled_stand(scene.robot))

    @property
    def base(self) -> str:
        """The robot's free body."""
        return self.scene.robot.base

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


@dataclass(frozen=True)
class Ring:
    """Positions on the floor: a ring around the origin, blurred.

    Attributes:
        inner, outer: radii [m].
        spread: standard deviation that is added to x and to y [m].
    """

    inner: float
    outer: float
    spread: float

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw (2,) [m], uniform in angle and radius before the blur."""
        angle, radius = rng.uniform(0.0, 2 * np.pi), rng.uniform(self.inner, self.outer)
        xy = radius * np.array([np.cos(angle), np.sin(angle)])
        return xy + rng.normal(0.0, self.spread, 2)


@dataclass(frozen=True)
class MoveReset:
    """Robot and object stand apart, and the object away from its goal.

    Attributes:
        object: the object's body.
        goal: its position there [m]; it starts at this height, upright.
        robot: draws where the robot stands.
        ring: where the object stands.
    """

    object: str
    goal: tuple[float, float, float]
    robot: RobotDraw
    ring: Ring

    def __call__(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """Draw until robot and object stand clear of each other and the task is not yet solved."""
        return redraw(lambda: self._draw(rng, start), lambda state: self._accept(state, start))

    def _draw(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        robot_xy, yaw = self.robot(rng)
        pos = np.array([*self.ring.draw(rng), self.goal[2]])
        return start.place(robot_xy, yaw, {self.object: (pos, np.array([1.0, 0.0, 0.0, 0.0]))})

    def _accept(self, state: np.ndarray, start: Start) -> bool:
        base, thing = (state[start.index.pose(b)][:2] for b in (start.base, self.object))
        apart = np.linalg.norm(base - thing) > CLEARANCE
        unsolved = np.linalg.norm(thing - self.goal[:2]) > AWAY
        return bool(apart and unsolved) and not start.touching(state, self.object)


@dataclass(frozen=True)
class UprightReset:
    """The object lies as it came to rest after a fall in any attitude, the robot stands clear.

    Attributes:
        object: the object's body.
        frames: that the success test sees.
        success: the task's; an object that rights itself in its fall is dropped anew.
        robot: draws where the robot stands.
        ring: above where the object is dropped.
    """

    object: str
    frames: Mapping[str, FrameRef]
    success: Callable[[View], np.ndarray]
    robot: RobotDraw
    ring: Ring

    def __call__(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """Drop until the object rests, not upright, and not where the robot stands."""
        alone = Drop(start.scene, self.object)
        return redraw(
            lambda: self._draw(rng, start, alone), lambda state: self._accept(state, start)
        )

    def _draw(self, rng: np.random.Generator, start: Start, alone: "Drop") -> np.ndarray:
        robot_xy, yaw = self.robot(rng)
        quat = rng.normal(size=4)
        pose, velocity = alone(self.ring.draw(rng), quat / np.linalg.norm(quat))
        state = start.place(robot_xy, yaw, {self.object: (pose[:3], pose[3:])})
        state[start.index.velocity(self.object)] = velocity
        return state

    def _accept(self, state: np.ndarray, start: Start) -> bool:
        if np.linalg.norm(state[start.index.velocity(self.object)]) > REST_SPEED:
            return False
        data = mujoco.MjData(start.model)
        data.qpos[:], data.qvel[:] = start.index.unpack(state)
        mujoco.mj_kinematics(start.model, data)
        view = ViewLayout(start.model, self.frames).at(data)
        return not self.success(view).any() and not start.touching(state, self.object)


class Drop:
    """Lets one object of a scene fall to the floor, the robot taken away."""

    def __init__(self, scene: Scene, name: str) -> None:
        """Compile the scene without its robot."""
        spec = build_spec(scene, PLANT)
        spec.delete(spec.body(scene.robot.base))
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._name = name
        index = StateIndex(self._model)
        self._pose, self._velocity = index.pose(name), index.velocity(name)

    def __call__(self, xy: np.ndarray, quat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Drop it above xy (2,) [m] in attitude quat (4,).

        Returns:
            The pose (7,) and velocity (6,) it ends with, laid out as in a state; an object that
            has found no place to rest still has speed.
        """
        mujoco.mj_resetData(self._model, self._data)
        pose = self._data.qpos[self._pose]
        pose[:] = [*xy, 0.0, *quat]
        pose[2] = DROP_HEIGHT - height_above_floor(self._model, self._data.qpos, self._name)
        self._wait(DROP_TIME)
        for _ in range(STOPS):  # without rolling friction it would never rest
            self._data.qvel[:] = 0.0
            self._wait(STOP_TIME)
        state = np.concatenate([self._data.qpos, self._data.qvel])
        return state[self._pose], state[self._velocity]

    def _wait(self, seconds: float) -> None:
        mujoco.mj_step(self._model, self._data, round(seconds / self._model.opt.timestep))


def redraw(
    draw: Callable[[], np.ndarray], accept: Callable[[np.ndarray], bool], tries: int = 1000
) -> np.ndarray:
    """Draw until accepted; a reset that cannot be reached is an error, not a hang."""
    for _ in range(tries):
        state = draw()
        if accept(state):
            return state
    raise SumoError(f"no acceptable reset in {tries} draws")
