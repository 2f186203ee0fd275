"""The whole planner in one process: what `--workers 0` runs, and what the services must equal."""

import time
from typing import Self

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation, Evaluator
from sumo_dist.planner.guidance import make_guide
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.report import PlanReport
from sumo_dist.rollout.interface import Engine


class LocalPlanning:
    """Plans with rollouts in this process and reports on each plan; a context manager.

    Attributes:
        seed: of the noise from the next plan on; at first the episode's.
        traces: candidates' paths of the newest plan, see `Evaluation.traces`.
        cpu_ms: that the newest plan took, of all threads of this process [ms].
    """

    def __init__(self, problem: Problem, config: EpisodeConfig, threads: int) -> None:
        """Plan for an episode's problem; settings may change from plan to plan."""
        self._problem, self._config, self._threads = problem, config, threads
        self._planner: Planner | None = None
        self._engine: Engine | None = None
        self._rollout_s = 0.0
        self.seed = self._seeded = config.seed
        self.traces = np.empty(0, np.float32)
        self.cpu_ms = 0.0

    def __enter__(self) -> Self:
        self._turn_to(self._config.planner)
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def __call__(self, request: PlanRequest, settings: PlannerConfig) -> PlanReport:
        """Make one plan.

        Raises:
            TaskError: a cost term raises, or is the reason that no candidate has a cost.
        """
        planner = self._turn_to(settings)
        began, cpu_began = time.perf_counter(), time.process_time()
        self._rollout_s = 0.0
        result = planner.plan(request, self._evaluate)
        plan_s = time.perf_counter() - began
        self.cpu_ms = (time.process_time() - cpu_began) * 1e3
        if result.failed:
            start = request.state, request.memory, request.cost.parameters
            self._evaluator.blame(*start, planner.shifted(request)[None])
        self.traces = result.evaluation.traces
        return PlanReport.of(result, plan_ms=plan_s * 1e3, own_ms=(plan_s - self._rollout_s) * 1e3)

    @property
    def engine(self) -> Engine:
        """The engine that rolls out under the settings of the episode."""
        self._turn_to(self._config.planner)
        assert self._engine is not None, "a planner has one"
        return self._engine

    @property
    def evaluator(self) -> Evaluator:
        """Rolls out and costs candidates under the settings of the episode."""
        self._turn_to(self._config.planner)
        return self._evaluator

    def _turn_to(self, settings: PlannerConfig) -> Planner:
        """Return the planner of some settings; only another model needs another engine."""
        same_seed = self.seed == self._seeded
        if self._planner is not None and self._planner.config == settings and same_seed:
            return self._planner
        options = planning_options(settings)
        if self._engine is None or options != self._options:
            if self._engine is not None:
                self._close()
                self._problem = Problem.build(self._problem.task, options)
            self._engine = self._problem.engine(self._threads, self._config.engine)
            self._options = options
        self._evaluator = Evaluator(self._problem, self._engine, settings)
        guide = make_guide(self._problem, settings)
        self._planner = Planner(settings, self._problem.task.actions, self.seed, guide)
        self._seeded = self.seed
        return self._planner

    def _close(self) -> None:
        if self._engine is not None:
            self._engine.close()

    def _evaluate(self, request: PlanRequest, _iteration: int, knots: np.ndarray) -> Evaluation:
        began = time.perf_counter()
        evaluation = self._evaluator(request.state, request.memory, request.cost.parameters, knots)
        self._rollout_s += time.perf_counter() - began
        return evaluation
