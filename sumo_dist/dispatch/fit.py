"""How many candidates a plan has when time is short: as many as the workers manage.

And no fewer than the optimizer can work with.
"""

from sumo_dist.planner.config import PlannerConfig

RESERVE = 0.75  # share of the time in which rollouts must fit; the rest is for their way and luck
FEWEST = 4  # with fewer, a plan says little about what was not tried


def fitted(config: PlannerConfig, rows_per_ms: float, budget_ms: float) -> int:
    """Return the number of candidates, at most the configured one.

    Args:
        config: of the planner; its optimizer needs an elite more than it keeps, and each of its
            iterations a candidate.
        rows_per_ms: what all workers together roll out, as measured.
        budget_ms: time until the plan must go out.
    """
    fewest = max(FEWEST, config.elites + 1, config.iterations)
    fits = int(RESERVE * rows_per_ms * budget_ms)
    return min(config.rollouts, max(fewest, fits))
