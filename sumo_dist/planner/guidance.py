"""Object-first guidance: how the object should travel, and how the base would bring that about.

The object is planned for alone: it goes straight to its goal. That takes a robot behind it, which
pushes along this line. A walk of the base is computed that goes round the object to there and then
pushes, and the planner adds it to its candidates: what it is worth the rollouts say.

All of it is seen from above. Vectors on the floor are complex numbers x + iy, and a heading is one
of length 1: v * heading turns v from the robot's frame into the world's.
"""

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from sumo_dist.math import splines
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem
from sumo_dist.timing import TICK

AT_GOAL = 1e-3  # nearer than this the object needs no push [m]
STRIDE = 0.2  # on a circle round the object the base heads for a point so far ahead [rad]
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))  # of a box, in its half sizes


@dataclass(frozen=True)
class Ground:
    """Robot and object as seen from above [m].

    Attributes:
        base, heading: of the robot.
        centre: of the object's mass.
        way: from where the object is to where it should be.
        radius: of the object, about its centre.
        back: from its centre to its rear, seen along the way.
        width: across the way.
        reach: from the robot's base to its front, at the heights of the object.
        keep: from base to centre while the robot goes round.
    """

    base: complex
    heading: complex
    centre: complex
    way: complex
    radius: float
    back: float
    width: float
    reach: float
    keep: float


@dataclass(frozen=True)
class Gait:
    """Limits (3,) of the base's velocities [m/s, m/s, rad/s], and how fast they may settle [s]."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    settling: float

    def fastest(self, direction: complex) -> float:
        """Speed that the base can have in a direction of its own frame, of length 1 [m/s]."""
        speed = math.inf
        for part, low, high in zip(
            (direction.real, direction.imag), self.lower, self.upper, strict=False
        ):
            if part:
                speed = min(speed, max(0.0, (high if part > 0 else low) / part))
        return speed

    def turn(self, angle: float) -> float:
        """Yaw rate that turns by an angle in a tick, or as near to it as can be [rad/s]."""
        return min(max(angle / TICK, self.lower[2]), self.upper[2])


def walk(ground: Ground, gait: Gait, ticks: int) -> np.ndarray:
    """Velocities (ticks, 3) of a base that goes behind the object and pushes it along its way.

    They are those of a point that has them at once: what lags and slips the rollouts know.
    """
    base, heading, centre, left = ground.base, ground.heading, ground.centre, abs(ground.way)
    velocities = np.zeros((ticks, 3))
    if left < AT_GOAL:
        return velocities
    along = ground.way / left
    for tick in range(ticks):
        behind = (base - centre) / -along  # x: how far behind the object, y: how far to its side
        gap = behind.real - ground.back - ground.reach
        pushes = behind.real > 0.0 and abs(behind.imag) < ground.width / 4
        if pushes:
            aim, facing = along * (max(gap, 0.0) + left + 1j * behind.imag), along
        else:
            aim, facing = _round(base - centre, along, ground.keep), centre - base
        direction = aim / abs(aim) / heading if abs(aim) > 0.0 else 1.0 + 0.0j
        speed = min(gait.fastest(direction), abs(aim) / gait.settling if pushes else math.inf)
        turn = gait.turn(cmath.phase(facing / heading))
        velocities[tick] = speed * direction.real, speed * direction.imag, turn
        step = speed * direction * heading * TICK
        base += step
        heading *= cmath.rect(1.0, turn * TICK)
        if pushes and gap <= 0.0:
            pushed = min((step / along).real, left)
            centre, left = centre + along * pushed, left - pushed
    return velocities


def _round(place: complex, along: complex, radius: float) -> complex:
    """Where to go from a place beside an object to come behind it, both relative to its centre.

    It is the shortest way round a circle: along a tangent up to it, then on it.
    """
    angle = cmath.phase(place / -along)
    tangent = math.acos(min(1.0, radius / abs(place))) if place else 0.0
    ahead = max(abs(angle) - tangent - STRIDE, 0.0)
    return cmath.rect(radius, math.copysign(ahead, angle)) * -along - place


class ObjectFirst:
    """Proposes knots of the base's velocities for a task whose goal is for an object."""

    def __init__(self, problem: Problem, config: PlannerConfig) -> None:
        """Read limits and shapes.

        Raises:
            UsageError: the task cannot be planned object first.
        """
        task, model = problem.task, problem.model
        task.check_settings(config)
        self._task, self._model, self._data = task, model, mujoco.MjData(model)
        self._frame = task.frames[task.goal_frame]
        self._object = model.body(task.goal_object).id
        tree = model.body_rootid[model.geom_bodyid]
        self._of_object = np.flatnonzero(tree == self._object)
        self._of_robot = np.flatnonzero(tree == model.body(task.scene.robot.base).id)
        velocities = [*task.actions.velocities]
        lower, upper = task.actions.lower[velocities], task.actions.upper[velocities]
        times = splines.knot_times(config.spline, config.nodes, config.horizon)
        self._times = times[times >= 0.0]
        spacing = self._times[1] if len(self._times) > 1 else config.horizon
        self._gait = Gait(tuple(lower.tolist()), tuple(upper.tolist()), float(spacing))
        self._ticks = config.steps
        share = np.clip(
            1.0 - np.abs(np.arange(config.steps) * TICK - self._times[:, None]) / spacing, 0.0, 1.0
        )
        self._mean = share / share.sum(axis=1, keepdims=True)  # (F, T): of the ticks about a knot

    def __call__(self, state: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Knots (F, 3) of the base from the start on, normalised, for a state (nq + nv,)."""
        velocities = walk(self.ground(state, parameters), self._gait, self._ticks)
        lower, upper = np.array(self._gait.lower), np.array(self._gait.upper)
        mean = (self._mean[:, :, None] * velocities).sum(axis=1)
        return np.clip((mean - lower) / (upper - lower) * 2.0 - 1.0, -1.0, 1.0)

    def ground(self, state: np.ndarray, parameters: np.ndarray) -> Ground:
        """Robot and object of a state (nq + nv,) from above, at parameters (n,) of the task."""
        model, data, task = self._model, self._data, self._task
        data.qpos[:] = state[: model.nq]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        goal = task.goal_position(task.table.named(parameters))
        assert goal is not None, "the task has been checked"
        named = getattr(data, self._frame.kind)(self._frame.name)
        base = data.body(task.scene.robot.base)
        centre = data.subtree_com[self._object]
        way = complex(*(goal - named.xpos)[:2])
        along = way / abs(way) if way else 1.0 + 0.0j
        heading = complex(*base.xmat.reshape(3, 3)[:2, 0])
        heading = heading / abs(heading) if heading else 1.0 + 0.0j
        thing = self._corners(self._of_object) - centre
        robot = self._corners(self._of_robot)
        heights = thing[..., 2].min() + centre[2], thing[..., 2].max() + centre[2]
        beside = (robot[..., 2].min(axis=1) < heights[1]) & (robot[..., 2].max(axis=1) > heights[0])
        robot = (robot[beside] if beside.any() else robot) - base.xpos
        across = thing[..., :2] @ _xy(along * 1j)
        radius = float(np.hypot(thing[..., 0], thing[..., 1]).max())
        reach = float((robot[..., :2] @ _xy(heading)).max())
        side = float(np.abs(robot[..., :2] @ _xy(heading * 1j)).max())
        return Ground(
            base=complex(*base.xpos[:2]),
            heading=heading,
            centre=complex(*centre[:2]),
            way=way,
            radius=radius,
            back=float(-(thing[..., :2] @ _xy(along)).min()),
            width=float(np.ptp(across)),
            reach=reach,
            keep=radius + (side if KEEP == "side" else reach),
        )

    def _corners(self, geoms: np.ndarray) -> np.ndarray:
        """Corners (G, 8, 3) of the boxes about geoms, world [m]."""
        model, data = self._model, self._data
        boxes = model.geom_aabb[geoms, None, :3] + CORNERS * model.geom_aabb[geoms, None, 3:]
        axes = data.geom_xmat[geoms].reshape(-1, 1, 3, 3)
        return data.geom_xpos[geoms][:, None] + (axes * boxes[:, :, None]).sum(axis=-1)


Guide = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(state (nq + nv,), parameters (n,)) -> knots (F, 3) of the base's velocities, normalised."""


def make_guide(problem: Problem, config: PlannerConfig) -> Guide | None:
    """Return what proposes candidates under some settings, None if nothing does.

    Raises:
        UsageError: the task cannot be planned with this guidance.
    """
    return ObjectFirst(problem, config) if config.guidance == "object" else None


def _xy(vector: complex) -> np.ndarray:
    return np.array([vector.real, vector.imag])
import os
KEEP = os.environ.get("GUIDE_KEEP","reach")
