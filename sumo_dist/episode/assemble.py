"""The one place where an episode is put together: everything that runs one begins here."""

import time
from dataclasses import dataclass
from typing import Self

import numpy as np

from sumo_dist.costs.blame import blamed, defined, fault_of
from sumo_dist.episode.command import Controls
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import Ending
from sumo_dist.episode.motion import measure
from sumo_dist.episode.referee import Referee
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.plant.body import Body
from sumo_dist.plant.noise import plant_profile
from sumo_dist.plant.simulated import Plant
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import saved
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.robot import Robot
from sumo_dist.rollout import engine_identity, make_controller
from sumo_dist.rollout.interface import Controller
from sumo_dist.tasks import load_task
from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK


@dataclass
class Episode:
    """All that takes part in an episode, but for who estimates and who plans.

    Attributes:
        config: what decides it.
        problem: its task, compiled for planning.
        body: the robot.
        guard: the way of every command to the body.
        controller: turns commands into joint targets, at the robot as in rollouts.
        referee: says when it is over.
        controls: what may change while it runs.
        recording: is written.
    """

    config: EpisodeConfig
    problem: Problem
    body: Body
    guard: CommandGuard
    controller: Controller
    referee: Referee
    controls: Controls
    recording: Recording

    @classmethod
    def assemble(
        cls, config: EpisodeConfig, body: Body | None = None, task: Task | None = None
    ) -> Self:
        """Put an episode together.

        Args:
            config: what decides it.
            body: the robot; by default a simulated one at the start that the task draws.
            task: takes the place of the one that the config names.

        Raises:
            UsageError: the config names what is not there, or does not fit the task.
        """
        task = task or load_task(config.task)
        problem = Problem.build(task, planning_options(config.planner))
        body = body or make_plant(config, task)
        about = config.describe(problem, engine_identity(config.engine))
        recording = Recording(about, model=saved(compile_model(task.scene, PLANT)))

        def send(targets: np.ndarray) -> None:
            recording.targets.append(targets)
            body.send(targets)

        return cls(
            config,
            problem,
            body,
            guard=CommandGuard(task.scene.robot, problem.model, send, TICK),
            controller=make_controller(problem.policy, problem.model, config.engine),
            referee=Referee(task, problem.model, config.time_limit),
            controls=Controls(config, task, body.can_hold),
            recording=recording,
        )

    @property
    def task(self) -> Task:
        """What is to be done."""
        return self.problem.task

    @property
    def robot(self) -> Robot:
        """Who does it."""
        return self.task.scene.robot

    def request(
        self, number: int, tick: int, state: np.ndarray, memory: np.ndarray, previous: Plan | None
    ) -> PlanRequest:
        """Ask for a plan under the weights and parameters of now."""
        return PlanRequest(number, tick, state, memory, previous, self.controls.cost)

    def note_tick(self, estimate: np.ndarray | None, memory: np.ndarray) -> None:
        """Record what a tick begins with; the estimate stands for a truth that nobody knows."""
        truth = self.body.truth
        state = estimate if truth is None else truth
        if state is not None:
            self.recording.add_tick(state, state if estimate is None else estimate, memory)

    def follow(
        self, action: np.ndarray, state: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Follow a normalised action (n,) for one tick.

        Returns:
            Joint targets (nu,) [rad] and the policy's next memory (nm,).
        """
        actions, nq = self.task.actions, self.problem.model.nq
        physical = actions.physical(action)
        self.recording.actions.append(physical)
        command = actions.to_command(physical)
        return self.controller.step(state[:nq], state[nq:], command, memory)

    def verdict(self, tick: int, estimate: np.ndarray) -> Ending | None:
        """Judge a tick on the true state, or on the estimate where nobody knows it."""
        truth = self.body.truth
        self.referee.parameters = self.controls.cost.parameters
        return self.referee.verdict(tick, estimate if truth is None else truth)

    def finish(self, ending: Ending, began: float) -> Ending:
        """Write the account of an episode that began at time.perf_counter() into its recording."""
        ending = ending.after(time.perf_counter() - began)
        self.recording.commands = self.guard.account()
        self.recording.operator = self.controls.commands
        self.recording.ending = ending.reason
        self.recording.motion = measure(self.recording, self.task, self.problem.model)
        return ending


def draw_start(task: Task, seed: int, parameters: np.ndarray | None = None) -> np.ndarray:
    """State (nq + nv,) that the task's reset draws for a seed, with parameters (n,) or its own.

    Raises:
        TaskError: the reset raises, or returns what is no state.
    """
    numbers = task.table.defaults.parameters if parameters is None else parameters
    start = Start.of(task.scene, task.frames, task.table.named(numbers))
    with blamed("reset"):
        state = np.asarray(task.reset(np.random.default_rng(seed), start), float)
    size = start.model.nq + start.model.nv
    if state.shape != (size,):
        reason = f"returned shape {state.shape}, must be ({size},): qpos, then qvel"
        raise fault_of("reset", defined(task.reset), reason)
    if not np.isfinite(state).all():
        raise fault_of("reset", defined(task.reset), "returned a state that is not finite")
    return state


def rehearse(config: EpisodeConfig, problem: Problem) -> None:
    """Call once each function of the task that the episode will call, its costs on a rollout.

    Raises:
        TaskError: one of them is at fault.
        UsageError: there is no such engine.
    """
    task, parameters = problem.task, config.cost(problem.task).parameters
    state, memory = draw_start(task, config.seed, parameters), problem.policy.initial_memory()
    referee = Referee(task, problem.model)
    referee.parameters = parameters
    referee.judge(state)
    stand = task.actions.unit(task.actions.default)
    knots = np.tile(stand, (1, config.planner.nodes, 1)).astype(np.float32)  # (1, K, n)
    with problem.engine(1, config.engine) as engine:
        Evaluator(problem, engine, config.planner)(state, memory, parameters, knots)


def make_plant(config: EpisodeConfig, task: Task) -> Plant:
    """Return the simulated robot of an episode at its start."""
    start = draw_start(task, config.seed, config.cost(task).parameters)
    profile = plant_profile(config.plant)
    return Plant(task.scene, start, config.estimator, profile, config.seed)
