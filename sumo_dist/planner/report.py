"""What a planner tells about each plan: the plan, its candidates' costs, and how it went."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanResult


@dataclass(frozen=True)
class PlanReport:
    """One plan with its account.

    Attributes:
        plan: to be followed.
        costs: (B,) candidates' total costs; 0 where not finite.
        finite: (B,) False where a candidate was lost, diverged or had a non-finite cost.
        terms: (n_terms,) weighted costs of the unperturbed candidate; 0 where not finite.
        weights, parameters: (n_terms,) and (n,), that it was made with.
        plan_ms: wall time from the request to the plan [ms].
        own_ms: the part of it spent outside rollouts and waiting for them [ms].
        age_ticks: policy ticks of robot time that the plan's state was old when it was sent.
        lost: candidates left out because nobody answered in time.
        reissued: candidates sent to a second worker.
        invalid: candidates that diverged.
        failed: no candidate had a finite cost; the plan is the shifted previous one.
        workers: rollout workers at hand, 0 in one process.
    """

    plan: Plan
    costs: np.ndarray
    finite: np.ndarray
    terms: np.ndarray
    weights: np.ndarray
    parameters: np.ndarray
    plan_ms: float
    own_ms: float
    age_ticks: int = 0
    lost: int = 0
    reissued: int = 0
    invalid: int = 0
    failed: bool = False
    workers: int = 0

    @classmethod
    def of(cls, result: PlanResult, plan_ms: float, own_ms: float, **account: int) -> Self:
        """Summarise a plan; the account holds counters where they are not zero."""
        evaluation = result.evaluation
        costs = evaluation.costs(result.cost.weights)
        finite = np.isfinite(costs)
        with np.errstate(invalid="ignore", over="ignore"):
            terms = result.cost.weights * evaluation.terms[0]
        return cls(
            plan=result.plan,
            costs=np.where(finite, costs, 0.0),
            finite=finite,
            terms=np.nan_to_num(terms, nan=0.0, posinf=0.0, neginf=0.0),
            weights=result.cost.weights,
            parameters=result.cost.parameters,
            plan_ms=plan_ms,
            own_ms=own_ms,
            lost=int((~evaluation.answered).sum()),
            invalid=int((evaluation.answered & ~evaluation.valid).sum()),
            failed=result.failed,
            **account,
        )
