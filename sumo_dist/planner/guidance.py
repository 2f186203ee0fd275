"""What proposes candidates to the planner: a plan for the object, or a learned policy.

A proposal is a candidate among those that are drawn: the rollouts say what it is worth, so guidance
changes nothing that a plan is judged by.
"""

from collections.abc import Callable
from itertools import product
from pathlib import Path

import mujoco
import numpy as np

from sumo_dist.math import splines
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.learned import LearnedPolicy
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem
from sumo_dist.planner.walk import Gait, Ground, walk
from sumo_dist.timing import TICK

CORNERS = np.array([*product((-1.0, 1.0), repeat=3)])  # of a box, in its half sizes

Guide = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(state (nq + nv,), parameters (p,), mean (F, n)) -> knots (F, n) from the start on, normalised.

The mean is that of the candidates that are drawn: the last plan, shifted.
"""


def make_guide(problem: Problem, config: PlannerConfig) -> Guide | None:
    """Return what proposes candidates under some settings; None if they ask for none.

    Raises:
        UsageError: the task cannot be planned with this guidance.
    """
    problem.task.check_settings(config)
    if config.guidance == "learned":
        return LearnedGuide(problem, config)
    return ObjectFirst(problem, config) if config.guidance == "object" else None


class LearnedGuide:
    """Proposes what a learned policy does in a state, as far as it can be trusted.

    As much of a knot as it cannot say stays that of the last plan: a policy that knows nothing of
    an arm's next second would else fold it in every plan.
    """

    def __init__(self, problem: Problem, config: PlannerConfig) -> None:
        """Load the policy.

        Raises:
            PolicyError: there is no such file, or it is for another kind of task.
        """
        self._policy = LearnedPolicy.load(Path(config.policy))
        self._policy.contract.check(problem)
        self._named = problem.task.table.named
        self._observe = Observer(problem.task, problem.model)
        times = splines.knot_times(config.spline, config.nodes, config.horizon)
        self._times = times[times >= 0.0]
        contract = self._policy.contract
        trust = contract.trust or np.ones(len(contract.times) * len(contract.actions))
        self._trust = self._lines(np.reshape(trust, (len(contract.times), -1)))

    def __call__(self, state: np.ndarray, parameters: np.ndarray, mean: np.ndarray) -> np.ndarray:
        """Knots (F, n) on the lines between the policy's; before and after these it holds them."""
        (knots,) = self._policy(self._observe(state[None], self._named(parameters)))
        return self._trust * self._lines(knots) + (1.0 - self._trust) * mean

    def _lines(self, knots: np.ndarray) -> np.ndarray:
        """What lines through the policy's knots (F', n) are at the planner's, (F, n)."""
        times = self._policy.contract.times
        return np.stack([np.interp(self._times, times, column) for column in knots.T], axis=1)


class ObjectFirst:
    """A guide for a task whose goal is for an object. It depends on state and parameters alone.

    The object is planned for first: it goes straight to its goal. That takes a robot behind it
    which pushes along this line, and proposed is the walk that does so; all but the base is as in
    the last plan. Other objects and fixtures it does not see: that its walk meets them the
    rollouts notice.
    """

    def __init__(self, problem: Problem, config: PlannerConfig) -> None:
        """Read the limits of the base from the task's actions, and the shapes from its model."""
        task, model = problem.task, problem.model
        self._task, self._model, self._data = task, model, mujoco.MjData(model)
        self._base = model.body(task.scene.robot.base).id
        self._object = model.body(task.goal_object).id
        self._velocities = task.actions.base
        root = model.body_rootid[model.geom_bodyid]
        self._of_robot = np.flatnonzero(root == self._base)
        self._of_object = np.flatnonzero(root == self._object)
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

    def __call__(self, state: np.ndarray, parameters: np.ndarray, mean: np.ndarray) -> np.ndarray:
        """Knots (F, n) from the start on: the mean's, but those of the base are the walk's."""
        knots = mean.copy()
        knots[:, self._velocities] = self.walk(state, parameters)
        return knots

    def walk(self, state: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Knots (F, 3) of the base from the start on, normalised: means of the walk around them.

        Args:
            state: (nq + nv,).
            parameters: (p,) of the task.
        """
        ground = self.ground(state, parameters)
        velocities = walk(ground, self._gait, self._around.shape[1])  # (T, 3)
        knots = (self._around[:, :, None] * velocities).sum(axis=1)
        return (knots - self._lower) / (self._upper - self._lower) * 2.0 - 1.0

    def ground(self, state: np.ndarray, parameters: np.ndarray) -> Ground:
        """Robot and object of a state from above; arguments as of `walk`."""
        model, data, task = self._model, self._data, self._task
        data.qpos[:] = state[: model.nq]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        frame = task.frames[task.goal_frame]
        place = (data.site if frame.kind == "site" else data.body)(frame.name).xpos
        goal = task.goal_position(task.table.named(parameters))
        assert goal is not None, "such a task is refused"
        way = _planar(goal - place)
        heading = _unit(_planar(data.xmat[self._base].reshape(3, 3)[:, 0]))
        base, centre = data.xpos[self._base], data.subtree_com[self._object]
        thing = np.vstack([centre, *self._corners(self._of_object)])
        robot = self._corners(self._of_robot)
        low, high = thing[:, 2].min(), thing[:, 2].max()
        beside = (robot[..., 2].min(axis=1) < high) & (robot[..., 2].max(axis=1) > low)
        thing, robot = thing - centre, np.vstack([base, *robot[beside]]) - base
        radius = float(np.hypot(thing[:, 0], thing[:, 1]).max())
        side = float(np.abs(_along(robot, heading * 1j)).max())
        return Ground(
            base=_planar(base),
            heading=heading,
            centre=_planar(centre),
            way=way,
            back=float(_along(thing, -_unit(way)).max()),
            width=float(np.ptp(_along(thing, _unit(way) * 1j))),
            reach=float(_along(robot, heading).max()),
            keep=radius + side,
        )

    def _corners(self, geoms: np.ndarray) -> np.ndarray:
        """Corners (G, 8, 3) of the boxes around geoms, world [m]."""
        model, data = self._model, self._data
        corners = model.geom_aabb[geoms, None, :3] + CORNERS * model.geom_aabb[geoms, None, 3:]
        axes = data.geom_xmat[geoms].reshape(-1, 1, 3, 3)
        return data.geom_xpos[geoms, None] + (axes * corners[:, :, None]).sum(axis=-1)


def _planar(vector: np.ndarray) -> complex:
    return complex(vector[0], vector[1])


def _unit(vector: complex) -> complex:
    """The direction of a vector; x of one that has none."""
    return vector / abs(vector) if vector else 1.0 + 0.0j


def _along(points: np.ndarray, direction: complex) -> np.ndarray:
    """How far points (P, 3) are in a direction, (P,) [m]."""
    return points[:, 0] * direction.real + points[:, 1] * direction.imag
