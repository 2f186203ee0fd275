"""What a plan leads to: it is rolled out here, once, on the planning model."""

import time
from contextlib import suppress
from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.costs.view import View
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK

EVERY_TICKS = 12  # of robot time between two plans that are rolled out; four a second
LIVE_SHARE = 0.05  # of wall time that this may take beside a live run


@dataclass(frozen=True)
class Ahead:
    """One rollout of T steps from a tick's state to the end of a plan.

    Attributes:
        model: that was rolled out.
        tick: of the state that it starts from.
        states: (T, nq + nv); row k is after step k, at tick + k + 1.
        targets: (T, nu) joint targets that the servos held during the step.
        view: the same by the names of the task, one rollout.
    """

    model: mujoco.MjModel
    tick: int
    states: np.ndarray
    targets: np.ndarray
    view: View


class Foresight:
    """Rolls out plans, one at a time; close it when done."""

    def __init__(self, task: Task, episode: EpisodeConfig) -> None:
        """Predict for an episode; the task is compiled when the first plan is rolled out."""
        self._task, self._episode = task, episode
        self._problem: Problem | None = None
        self._engine: Engine | None = None
        self._unable = False

    def of(
        self, plan: Plan, tick: int, state: np.ndarray, memory: np.ndarray, parameters: np.ndarray
    ) -> Ahead | None:
        """Roll a plan out from a tick's state (nq + nv,) and policy memory (nm,) to its end.

        None if the rollout diverges, or if this machine cannot roll the task out.
        """
        until = plan.tick + round(plan.horizon / TICK)
        if not self._ready() or until <= tick:
            return None
        assert self._engine is not None and self._problem is not None, "it is ready"
        actions = self._task.actions
        physical = actions.physical(plan.at(np.arange(tick, until)))[None]  # (1, T, nu)
        ahead = self._engine.rollout(state, memory, actions.to_command(physical))
        if not ahead.valid[0]:
            return None
        view = self._problem.layout.view(
            *(ahead.states, ahead.targets, ahead.positions, ahead.rotations, physical),
            self._task.table.named(parameters),
        )
        return Ahead(self._problem.model, tick, ahead.states[0], ahead.targets[0], view)

    def close(self) -> None:
        """Free the engine."""
        if self._engine is not None:
            self._engine.close()
            self._engine = None
        self._unable = True

    def _ready(self) -> bool:
        if self._engine is None and not self._unable:
            self._unable = True  # tried once
            with suppress(SumoError):  # such as a policy that is not here: a view without it
                problem = Problem.build(self._task, planning_options(self._episode.planner))
                self._engine = problem.engine(1, self._episode.engine)
                self._problem = problem
        return self._engine is not None


class Allowance:
    """Keeps work that can be left out within a share of wall time."""

    def __init__(self, share: float) -> None:
        """Allow a share of wall time, 1 for all of it."""
        self._share = share
        self._next = self._began = -np.inf

    def __enter__(self) -> None:
        self._began = time.monotonic()

    def __exit__(self, *_: object) -> None:
        now = time.monotonic()
        self._next = now + (now - self._began) * (1.0 / self._share - 1.0)

    @property
    def left(self) -> bool:
        """Whether there is time for more of it now."""
        return time.monotonic() >= self._next
