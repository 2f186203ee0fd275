"""Drawing start states: a settled stance, a place for the robot, a place for each object."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations
from typing import Protocol, Self

import mujoco
import numpy as np

from sumo_dist.costs.fields import checked_number
from sumo_dist.costs.parameters import NO_PARAMETERS, Parameters
from sumo_dist.costs.view import View, ViewLayout
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.math.rotations import from_rotation_vector, multiply
from sumo_dist.model.files import find_model
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, Scene, compile_model
from sumo_dist.model.settle import (
    LOST,
    height_above_floor,
    settled_stand,
    why_it_falls,
    without_robot,
)

DROP_HEIGHT = 0.02  # of the object's lowest point above the floor [m]
DROP_TIME = 3.0  # a dropped object has come to rest by then, but for what rolls [s]
STOPS, STOP_TIME = 5, 0.2  # what rolls is stopped so often, and let go for so long [s]
REST_SPEED = 0.1  # what counts as rest, all six velocities together [m/s, rad/s]

FloorDraw = Callable[[np.random.Generator], tuple[np.ndarray, float]]
"""rng -> xy (2,) [m] and yaw [rad]."""


@dataclass(frozen=True)
class Start:
    """What a reset draws from and writes into.

    Attributes:
        scene: the task's.
        model: the plant's model of it.
        index: named access to its state.
        stance: (nq_robot,) qpos of the settled robot at the origin, yaw 0.
        frames: the task's.
        p: values of the task's parameters.
    """

    scene: Scene
    model: mujoco.MjModel
    index: StateIndex
    stance: np.ndarray
    frames: Mapping[str, FrameRef]
    p: Parameters

    @classmethod
    def of(
        cls,
        scene: Scene,
        frames: Mapping[str, FrameRef] | None = None,
        parameters: Parameters = NO_PARAMETERS,
    ) -> Self:
        """Compile a scene and settle its robot, unless that was done before."""
        known = _compiled(scene, _stamps(scene))
        return cls(
            scene, known.model, StateIndex(known.model), known.stance, frames or {}, parameters
        )

    @property
    def base(self) -> str:
        """The robot's free body."""
        return self.scene.robot.base

    def place(
        self, robot_xy: np.ndarray, yaw: float, objects: Mapping[str, tuple[np.ndarray, np.ndarray]]
    ) -> np.ndarray:
        """State (nq + nv,) at rest with the robot at xy, yaw and objects at (pos, quat wxyz)."""
        qpos, qvel = self.model.qpos0.copy(), np.zeros(self.model.nv)
        qpos[: len(self.stance)] = self.stance
        pose = self.index.pose(self.base)
        qpos[pose][:2] = robot_xy
        qpos[pose][3:] = upright(yaw)
        for name, (pos, quat) in objects.items():
            qpos[self.index.pose(name)] = np.concatenate([pos, quat])
        return np.concatenate([qpos, qvel])

    def view(self, state: np.ndarray) -> View:
        """Name the arrays of a state."""
        data = mujoco.MjData(self.model)
        data.qpos[:], data.qvel[:] = self.index.unpack(state)
        mujoco.mj_kinematics(self.model, data)
        return ViewLayout(self.model, self.frames).at(data, parameters=self.p)

    def touching(self, state: np.ndarray, *names: str) -> bool:
        """Whether any two of the robot and some objects are in contact (or overlap) at a state."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = state[: self.model.nq]
        mujoco.mj_forward(self.model, data)
        roots = self.model.body_rootid[self.model.geom_bodyid[data.contact.geom]]
        free = {self.model.body(name).id for name in (self.base, *names)}
        return any(first != second and {first, second} <= free for first, second in roots.tolist())

    def drop(self, name: str) -> "Drop":
        """Return what lets an object of the scene fall alone."""
        return _compiled(self.scene, _stamps(self.scene)).drop(name)


class _Compiled:
    """What is compiled once for all starts of a scene."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._drops: dict[str, Drop] = {}
        self.model = compile_model(scene, PLANT)

    @cached_property
    def stance(self) -> np.ndarray:
        return settled_stand(self._scene.robot)

    def drop(self, name: str) -> "Drop":
        if name not in self._drops:
            self._drops[name] = Drop(self._scene, name)
        return self._drops[name]


@lru_cache(maxsize=4)
def _compiled(scene: Scene, _stamps: tuple[int, ...]) -> _Compiled:
    return _Compiled(scene)


def _stamps(scene: Scene) -> tuple[int, ...]:
    """Times of change [ns] of the scene's files: one that is edited is compiled anew."""
    files = (find_model(thing.mjcf) for thing in (scene.robot, *scene.objects, *scene.fixtures))
    return tuple(file.stat().st_mtime_ns for file in files)


class Placement(Protocol):
    """Where one object is at the start of an episode."""

    @property
    def body(self) -> str:
        """The object's root body."""
        ...

    def draw(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """Position [m], quaternion wxyz and velocity, as in a state, (13,)."""
        ...


@dataclass(frozen=True)
class OnFloor:
    """An object stands on the floor.

    Attributes:
        body: the object's root body.
        where: draws its place.
        z: height of its origin [m].
    """

    body: str
    where: FloorDraw
    z: float

    def __post_init__(self) -> None:
        checked_number(f"height of {self.body!r} on the floor", self.z)

    def draw(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """See `Placement.draw`."""
        del start
        xy, yaw = self.where(rng)
        return np.concatenate([xy, [self.z], upright(yaw), np.zeros(6)])


@dataclass(frozen=True)
class Dropped:
    """An object lies as it came to rest after a fall, the robot taken away.

    Attributes:
        body: the object's root body.
        where: draws the place above which it is dropped.
        attitudes: in one of which it falls, rotation vectors [rad] from upright, turned by the yaw
            of its place; by default it falls in any attitude, and its place's yaw does not count.
    """

    body: str
    where: FloorDraw
    attitudes: tuple[tuple[float, float, float], ...] = ()

    def draw(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """See `Placement.draw`; an object that has found no place to rest still has speed."""
        if not self.attitudes:
            quat = rng.normal(size=4)
            xy, _ = self.where(rng)
            return start.drop(self.body)(xy, quat / np.linalg.norm(quat))
        turn = np.array(self.attitudes[int(rng.integers(len(self.attitudes)))])
        xy, yaw = self.where(rng)
        return start.drop(self.body)(xy, multiply(upright(yaw), from_rotation_vector(turn)))


@dataclass(frozen=True)
class Reset:
    """Robot and objects at their places, at rest and apart.

    Attributes:
        robot: draws where the robot stands.
        objects: where each object is; drawn in this order, after the robot.
        clearance: between any two of them, centre to centre on the floor [m].
        solved: what must not hold at the start, such as the task's success.
    """

    robot: FloorDraw
    objects: tuple[Placement, ...] = ()
    clearance: float = 0.0
    solved: Callable[[View], np.ndarray] | None = None

    def __post_init__(self) -> None:
        checked_number("clearance of a reset", self.clearance, 0.0)

    def __call__(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """Draw until all hold."""
        refused = Counter[str]()

        def accept(state: np.ndarray) -> bool:
            refusal = self._refusal(state, start)
            refused[refusal] += 1
            return not refusal

        return redraw(lambda: self._draw(rng, start), accept, lambda: refused.most_common(1)[0][0])

    def _draw(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        robot_xy, yaw = self.robot(rng)
        drawn = {thing.body: thing.draw(rng, start) for thing in self.objects}
        poses = {name: (state[:3], state[3:7]) for name, state in drawn.items()}
        placed = start.place(robot_xy, yaw, poses)
        for name, state in drawn.items():
            placed[start.index.velocity(name)] = state[7:]
        return placed

    def _refusal(self, state: np.ndarray, start: Start) -> str:
        """Say why a state is no start, "" if it is one."""
        names = [thing.body for thing in self.objects]
        for name in names:
            if np.linalg.norm(state[start.index.velocity(name)]) > REST_SPEED:
                return f"{name} has not come to rest"
        places = {body: state[start.index.pose(body)][:2] for body in (start.base, *names)}
        for (one, here), (other, there) in combinations(places.items(), 2):
            if np.linalg.norm(here - there) <= self.clearance:
                return f"{one} and {other} are no more than {self.clearance:g} m apart"
        if self.solved is not None and self.solved(start.view(state)).any():
            return "it is solved already"
        return "two of them touch" if start.touching(state, *names) else ""


@dataclass(frozen=True)
class Ring:
    """Places on the floor: a ring around the origin, blurred; yaw 0.

    Attributes:
        inner, outer: radii [m].
        spread: standard deviation that is added to x and to y [m].
    """

    inner: float
    outer: float
    spread: float

    def __post_init__(self) -> None:
        inner = checked_number("inner radius of a ring", self.inner, 0.0)
        checked_number("outer radius of a ring", self.outer, inner)
        checked_number("spread of a ring", self.spread, 0.0)

    def __call__(self, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        """Draw a place, uniform in angle and radius before the blur."""
        angle, radius = rng.uniform(0.0, 2 * np.pi), rng.uniform(self.inner, self.outer)
        xy = radius * np.array([np.cos(angle), np.sin(angle)])
        return xy + rng.normal(0.0, self.spread, 2), 0.0


def near(xy: tuple[float, float], position: float, yaw: float) -> FloorDraw:
    """Draw within a distance of a place on both axes [m], and of facing along x [rad]."""

    def draw(rng: np.random.Generator) -> tuple[np.ndarray, float]:
        turn = float(rng.uniform(-yaw, yaw))
        return np.array(xy) + rng.uniform(-position, position, 2), turn

    return draw


def anywhere_within(half: float) -> FloorDraw:
    """Draw within a square around the origin, half as long [m], in any heading."""

    def draw(rng: np.random.Generator) -> tuple[np.ndarray, float]:
        xy = rng.uniform(-half, half, 2)
        return xy, float(rng.uniform(0.0, 2 * np.pi))

    return draw


def upright(yaw: float) -> np.ndarray:
    """Quaternion wxyz (4,) of a turn about the vertical [rad]."""
    return np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


class Drop:
    """Lets one object of a scene fall to the floor, the robot and all other objects taken away."""

    def __init__(self, scene: Scene, name: str) -> None:
        """Compile the scene with nothing but the object and the fixtures."""
        alone = replace(scene, objects=tuple(o for o in scene.objects if o.name == name))
        self._model = without_robot(alone)
        self._data = mujoco.MjData(self._model)
        self._name = name
        index = StateIndex(self._model)
        self._pose, self._velocity = index.pose(name), index.velocity(name)

    def __call__(self, xy: np.ndarray, quat: np.ndarray) -> np.ndarray:
        """Drop it above xy (2,) [m] in attitude quat (4,); return how it ends, see `Placement`.

        Raises:
            UsageError: nothing of it can lie on the floor.
        """
        mujoco.mj_resetData(self._model, self._data)
        pose = self._data.qpos[self._pose]
        pose[:] = [*xy, 0.0, *quat]
        pose[2] = DROP_HEIGHT - height_above_floor(self._model, self._data.qpos, self._name)
        height = float(pose[2])
        self._wait(DROP_TIME)
        if not pose[2] > height - LOST:  # nor is it a number
            reason = why_it_falls(self._model, self._name)
            raise UsageError(f"{self._name!r} falls through the floor: {reason}")
        for _ in range(STOPS):  # without rolling friction it would never rest
            self._data.qvel[:] = 0.0
            self._wait(STOP_TIME)
        state = np.concatenate([self._data.qpos, self._data.qvel])
        return np.concatenate([state[self._pose], state[self._velocity]])

    def _wait(self, seconds: float) -> None:
        mujoco.mj_step(self._model, self._data, round(seconds / self._model.opt.timestep))


def redraw(
    draw: Callable[[], np.ndarray],
    accept: Callable[[np.ndarray], bool],
    why_not: Callable[[], str] = lambda: "none was accepted",
    tries: int = 1000,
) -> np.ndarray:
    """Draw until accepted; a reset that cannot be reached is an error, not a hang.

    Args:
        draw: returns a state.
        accept: whether it will do.
        why_not: says why none did, once all tries have been made.
        tries: at most.
    """
    for _ in range(tries):
        state = draw()
        if accept(state):
            return state
    raise SumoError(f"no acceptable reset in {tries} draws, mostly: {why_not()}")
