"""The whole planner in one process: what `--workers 0` runs, and what the services must equal."""

import time

import numpy as np

from sumo_dist.planner.evaluate import Evaluation, Evaluator
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.report import PlanReport


class LocalPlanning:
    """Plans with rollouts in this process and reports on each plan."""

    def __init__(self, planner: Planner, evaluator: Evaluator) -> None:
        """Join a planner with the evaluator of its task."""
        self._planner = planner
        self._evaluator = evaluator
        self._rollout_s = 0.0
        self.traces = np.empty(0, np.float32)  # of the newest plan: see Evaluation.traces

    def __call__(self, request: PlanRequest) -> PlanReport:
        """Make one plan."""
        began = time.perf_counter()
        self._rollout_s = 0.0
        result = self._planner.plan(request, self._evaluate)
        plan_s = time.perf_counter() - began
        self.traces = result.evaluation.traces
        return PlanReport.of(result, plan_ms=plan_s * 1e3, own_ms=(plan_s - self._rollout_s) * 1e3)

    def _evaluate(self, request: PlanRequest, _iteration: int, knots: np.ndarray) -> Evaluation:
        began = time.perf_counter()
        evaluation = self._evaluator(request.state, request.memory, knots)
        self._rollout_s += time.perf_counter() - began
        return evaluation
