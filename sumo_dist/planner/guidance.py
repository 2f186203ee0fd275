"""Object-first guidance: how an object should travel to its goal, and what the base does for it.

The object is planned for alone: it goes straight to its goal and stops there. A base that has part
in this goes the same way at the same speed, facing the object, whether the robot pushes, pulls or
carries it. That becomes a candidate of the planner, among those that are drawn: the rollouts say
what it is worth, so guidance changes nothing that a plan is judged by.

All of it is seen from above. Vectors on the floor are complex numbers x + iy, and a heading is one
of length 1: v * heading turns v from the robot's frame into the world's.
"""

import cmath
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.math import splines
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem
from sumo_dist.timing import TICK

Guide = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(state (nq + nv,), parameters (n,)) -> knots (F, 3) of the base from the start on, normalised."""


def make_guide(problem: Problem, config: PlannerConfig) -> Guide | None:
    """Return what proposes a candidate under some settings; None if they ask for none.

    Raises:
        UsageError: the task cannot be planned with this guidance.
    """
    problem.task.check_settings(config)
    return ObjectFirst(problem, config) if config.guidance == "object" else None


@dataclass(frozen=True)
class Ground:
    """Robot and object as they stand.

    Attributes:
        heading: of the robot.
        place: of the object's centre of mass, from the robot's base, world [m].
        way: from where the object is to where it should be, world [m].
    """

    heading: complex
    place: complex
    way: complex


@dataclass(frozen=True)
class Gait:
    """What the base can do.

    Attributes:
        lower, upper: limits of its velocities x, y and yaw [m/s, m/s, rad/s].
        settling: in how many seconds it slows down where the object should be [s].
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    settling: float

    def fastest(self, direction: complex) -> float:
        """Speed that it can have in a direction, of length 1, of its own frame [m/s]."""
        parts = zip((direction.real, direction.imag), self.lower, self.upper, strict=False)
        return min(
            max(0.0, (high if part > 0 else low) / part) for part, low, high in parts if part
        )

    def turn(self, angle: float) -> float:
        """Yaw rate that turns by an angle [rad] within a tick, or the nearest that it can have."""
        return min(max(angle / TICK, self.lower[2]), self.upper[2])


def along_with(ground: Ground, gait: Gait, ticks: int) -> np.ndarray:
    """Velocities x, y and yaw, (ticks, 3), of a base that goes with the object and turns to it.

    It is a point that has its velocities at once: what lags or slips the rollouts know.
    """
    velocities = np.zeros((ticks, 3))
    heading, left = ground.heading, abs(ground.way)
    along, facing = _unit(ground.way), _unit(ground.place)
    for tick in range(ticks):
        direction = along / heading
        speed = min(gait.fastest(direction), left / gait.settling)
        turn = gait.turn(cmath.phase(facing / heading))
        velocities[tick] = speed * direction.real, speed * direction.imag, turn
        left -= speed * TICK
        heading *= cmath.rect(1.0, turn * TICK)
    return velocities


class ObjectFirst:
    """A guide for a task whose goal is for an object. State and parameters alone decide.

    Other objects and fixtures it does not see: that they are in the way the rollouts notice.
    """

    def __init__(self, problem: Problem, config: PlannerConfig) -> None:
        """Take the limits of the base from the task's actions, where things are from its model."""
        task, model = problem.task, problem.model
        self._task, self._model, self._data = task, model, mujoco.MjData(model)
        self._base = model.body(task.scene.robot.base).id
        self._object = model.body(task.goal_object).id
        velocities = task.actions.searched[task.actions.base]
        self._lower, self._upper = task.actions.lower[velocities], task.actions.upper[velocities]
        times = splines.knot_times(config.spline, config.nodes, config.horizon)
        times = times[times >= 0.0]
        spacing = max(TICK, times[1]) if len(times) > 1 else config.horizon
        limits = tuple(self._lower.tolist()), tuple(self._upper.tolist())
        self._gait = Gait(*limits, settling=float(spacing))
        ticks = np.arange(config.steps + 1) * TICK
        share = np.maximum(0.0, 1.0 - np.abs(ticks - times[:, None]) / spacing)
        self._around = share / share.sum(axis=1, keepdims=True)  # (F, T): of ticks in a knot

    def __call__(self, state: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Knots (F, 3) of the base from the start on, normalised: means of what is around them.

        Args:
            state: (nq + nv,).
            parameters: (n,) of the task.
        """
        ground = self.ground(state, parameters)
        velocities = along_with(ground, self._gait, self._around.shape[1])  # (T, 3)
        knots = (self._around[:, :, None] * velocities).sum(axis=1)
        return (knots - self._lower) / (self._upper - self._lower) * 2.0 - 1.0

    def ground(self, state: np.ndarray, parameters: np.ndarray) -> Ground:
        """Robot and object of a state from above; arguments as of `__call__`."""
        model, data, task = self._model, self._data, self._task
        data.qpos[:] = state[: model.nq]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        frame = task.frames[task.goal_frame]
        moved = (data.site if frame.kind == "site" else data.body)(frame.name).xpos
        goal = task.goal_position(task.table.named(parameters))
        assert goal is not None, "such a task is refused"
        return Ground(
            heading=_unit(_planar(data.xmat[self._base].reshape(3, 3)[:, 0])),
            place=_planar(data.subtree_com[self._object] - data.xpos[self._base]),
            way=_planar(goal - moved),
        )


def _planar(vector: np.ndarray) -> complex:
    return complex(vector[0], vector[1])


def _unit(vector: complex) -> complex:
    """The direction of a vector; x of one that has none."""
    return vector / abs(vector) if vector else 1.0 + 0.0j
