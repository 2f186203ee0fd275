"""Costs of candidate plans: knots -> commands -> rollouts -> cost terms -> weighted costs."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.costs import terms
from sumo_dist.costs.blame import defined, fault_of
from sumo_dist.errors import UsageError
from sumo_dist.math import splines
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import actions_of
from sumo_dist.planner.problem import Problem
from sumo_dist.rollout.interface import Engine, Rollouts
from sumo_dist.timing import TICK

TRACE_POINTS = 25


@dataclass(frozen=True)
class Evaluation:
    """What came back of B candidates.

    Attributes:
        terms: (B, n_terms) reduced residuals, unweighted; rows that were lost or invalid are NaN.
        valid: (B,) the rollout stayed finite.
        answered: (B,) False for candidates nobody rolled out in time.
        traces: (B, F, P, 3) float32 thinned paths of the trail frames, world [m]; empty where
            they stay with the workers.
    """

    terms: np.ndarray
    valid: np.ndarray
    answered: np.ndarray
    traces: np.ndarray

    def costs(self, weights: np.ndarray) -> np.ndarray:
        """Total cost (B,) at weights (n_terms,).

        It is +inf where a candidate is lost, invalid or its cost is not finite.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            total = weights[0] * self.terms[:, 0]
            for i in range(1, self.terms.shape[1]):
                total += weights[i] * self.terms[:, i]
        return np.where(self.valid & np.isfinite(total), total, np.inf)


class Evaluator:
    """Rolls out and costs candidates on this machine. A row's cost is the same in any batch."""

    def __init__(self, problem: Problem, engine: Engine, config: PlannerConfig) -> None:
        """Use an engine that records the problem's frames."""
        self._problem = problem
        self._engine = engine
        times = np.arange(config.steps) * TICK
        self._weights = splines.weights(config.spline, config.nodes, config.horizon, times)
        self._thin = np.linspace(0, config.steps - 1, TRACE_POINTS).round().astype(int)
        names = problem.layout.names
        self._trails = [names.index(name) for name in problem.task.trails]
        self._knots_shape = config.nodes, problem.task.actions.size

    def __call__(
        self, state: np.ndarray, memory: np.ndarray, parameters: np.ndarray, knots: np.ndarray
    ) -> Evaluation:
        """Evaluate knots (B, K, n) from a state (nq + nv,) and policy memory (nm,).

        Args:
            state, memory: where the rollouts start.
            parameters: (n,) of the task, see `CostSettings`.
            knots: the candidates.

        Raises:
            UsageError: an array of the wrong shape.
        """
        rollouts, physical = self.roll_out(state, memory, knots)
        terms = self.terms(rollouts, physical, parameters)
        terms[~rollouts.valid] = np.nan
        traces = rollouts.positions[:, self._thin][:, :, self._trails].astype(np.float32)
        answered = np.ones(len(knots), bool)
        return Evaluation(terms, rollouts.valid, answered, traces.transpose(0, 2, 1, 3))

    def blame(
        self, state: np.ndarray, memory: np.ndarray, parameters: np.ndarray, knots: np.ndarray
    ) -> None:
        """Find out whether a term is to blame for a plan none of whose candidates has a cost.

        Args:
            state, memory, parameters: as of `__call__`.
            knots: (1, K, n) of one candidate.

        Raises:
            TaskError: its rollout stays finite, and a term of it does not, or raises.
        """
        evaluation = self(state, memory, parameters, knots)
        finite = np.isfinite(evaluation.terms[0])  # (n_terms,)
        if evaluation.valid[0] and not finite.all():
            term = self._problem.task.cost[int(np.argmin(finite))]
            reason = "not finite in any rollout"
            raise fault_of(term.what, defined(term.residual) or term.made, reason)

    def roll_out(
        self, state: np.ndarray, memory: np.ndarray, knots: np.ndarray
    ) -> tuple[Rollouts, np.ndarray]:
        """Roll out knots (B, K, n); return also their physical actions (B, T, nu)."""
        if knots.ndim != 3 or knots.shape[1:] != self._knots_shape:
            nodes, size = self._knots_shape
            raise UsageError(
                f"knots have shape {knots.shape}; they need (rollouts, {nodes}, {size})"
            )
        actions = self._problem.task.actions
        physical = actions.physical(actions_of(self._weights, knots))  # (B, T, nu)
        return self._engine.rollout(state, memory, actions.to_command(physical)), physical

    def terms(self, rollouts: Rollouts, physical: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Cost terms (B, n_terms) of rollouts, unweighted, under parameters (n,)."""
        task = self._problem.task
        view = self._problem.layout.view(
            *(rollouts.states, rollouts.targets, rollouts.positions, rollouts.rotations, physical),
            task.table.named(parameters),
        )
        with np.errstate(invalid="ignore", over="ignore"):
            return terms.evaluate(task.cost, view)
