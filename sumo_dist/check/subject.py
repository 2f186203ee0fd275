"""A task under examination, and what several of its checks look at."""

from functools import cached_property

import mujoco
import numpy as np

from sumo_dist.check.world import World
from sumo_dist.costs.view import View
from sumo_dist.episode.assemble import draw_start
from sumo_dist.episode.referee import Referee
from sumo_dist.math.rotations import from_rotation_vector, multiply
from sumo_dist.math.splines import given
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.model.settle import height_above_floor
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks.task import Task

NUDGES, PLANS = 4, 8  # starts with the objects tilted and set in motion, and plans from each
NUDGE = 0.5  # spread of the objects' speeds there [m/s, rad/s]
TILT = 0.2  # spread of their turn about each level axis there [rad]


class Subject:
    """A task under examination; what several checks look at is made once.

    Attributes:
        task: the task.
        seeds: how many starts are drawn.
        config: the planner's default settings.
    """

    def __init__(self, task: Task, seeds: int) -> None:
        """Take a task that loads."""
        self.task, self.seeds, self.config = task, seeds, PlannerConfig.resolve(task.planner)

    @cached_property
    def plant(self) -> mujoco.MjModel:
        """The plant's model."""
        return compile_model(self.task.scene, PLANT)

    @cached_property
    def problem(self) -> Problem:
        """What is planned for."""
        return Problem.build(self.task, planning_options(self.config))

    @cached_property
    def world(self) -> World:
        """The plant's scene without the robot."""
        return World(self.task.scene, self.plant)

    @cached_property
    def referee(self) -> Referee:
        """Who judges states of the plant."""
        return Referee(self.task, self.plant)

    @cached_property
    def starts(self) -> list[np.ndarray]:
        """The start (nq + nv,) of each seed."""
        return [draw_start(self.task, seed) for seed in range(self.seeds)]

    @cached_property
    def terms(self) -> np.ndarray:
        """(seeds, NUDGES * PLANS, n_terms) weighted costs of random plans, objects nudged."""
        rng = np.random.default_rng(0)
        with self.problem.engine(1) as engine:
            evaluator = self.evaluator(engine)
            rows = [
                self.costs(evaluator, self.nudged(start, rng), self.knots(PLANS, rng))
                for start in self.starts
                for _ in range(NUDGES)
            ]
        return np.reshape(rows, (self.seeds, NUDGES * PLANS, -1))

    def evaluator(self, engine: Engine) -> Evaluator:
        """Return what rolls out and costs plans on an engine."""
        return Evaluator(self.problem, engine, self.config)

    def costs(self, evaluator: Evaluator, state: np.ndarray, knots: np.ndarray) -> np.ndarray:
        """(B, n_terms) weighted costs of knots (B, K, n) from a state, or from one each."""
        memory, cost = self.problem.policy.initial_memory(), self.task.table.defaults
        rollouts, physical = evaluator.roll_out(state, memory, knots)
        with np.errstate(all="ignore"):
            return cost.weights * evaluator.terms(rollouts, physical, cost.parameters)

    def nudged(self, start: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return a start with every object tilted and in motion, as high above the floor as it was.

        Untouched, most would not move at all, and no random plan topples what is heavy: terms about
        an object would look dead.
        """
        state, index = start.copy(), StateIndex(self.plant)
        qpos = state[: self.plant.nq]
        for body in index.free_bodies:
            if body == self.task.scene.robot.base:
                continue
            pose, height = qpos[index.pose(body)], height_above_floor(self.plant, qpos, body)
            turn = from_rotation_vector(np.array([*rng.normal(0.0, TILT, 2), 0.0]))
            pose[3:] = multiply(turn, pose[3:])
            pose[2] += height - height_above_floor(self.plant, qpos, body)
            state[index.velocity(body)] = rng.normal(0.0, NUDGE, 6)
        return state

    def knots(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Random knots (count, K, n) of a robot that has stood until now."""
        actions = self.task.actions
        knots = np.clip(rng.normal(0.0, 0.5, (count, self.config.nodes, actions.size)), -1.0, 1.0)
        knots[:, : given(self.config.spline)] = actions.unit(actions.default)
        return knots

    def view(self, state: np.ndarray) -> View:
        """Name the arrays of one state."""
        return self.referee.view(state)

    def simulation(self, state: np.ndarray) -> mujoco.MjData:
        """Return the plant at a state, contacts included."""
        data = mujoco.MjData(self.plant)
        data.qpos[:], data.qvel[:] = np.split(state, [self.plant.nq])
        mujoco.mj_forward(self.plant, data)
        return data
