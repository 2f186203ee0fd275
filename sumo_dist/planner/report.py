"""What a planner tells about each plan: the plan, its candidates' costs, and how it went."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.planner.plan import Plan


@dataclass(frozen=True)
class PlanReport:
    """One plan with its account.

    Attributes:
        plan: to be followed.
        costs: (B,) candidates' total costs; 0 where not finite.
        finite: (B,) False where a candidate was lost, diverged or had a non-finite cost.
        terms: (n_terms,) weighted costs of the unperturbed candidate; 0 where not finite.
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
    plan_ms: float
    own_ms: float
    age_ticks: int = 0
    lost: int = 0
    reissued: int = 0
    invalid: int = 0
    failed: bool = False
    workers: int = 0
