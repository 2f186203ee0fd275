"""What fits when time is short: how long a plan may take, and how many candidates it then has."""

import math
from collections.abc import Collection

from sumo_dist.dispatch.pace import Pace
from sumo_dist.planner.config import PlannerConfig

RESERVE = 0.75  # share of the time in which rollouts must fit; the rest is for luck
FEWEST = 4  # with fewer, a plan says little about what was not tried
ROLLING = 0.5  # share of a planning period that must be left for rollouts
MOST_PERIODS = 10


def fitted(config: PlannerConfig, paces: Collection[Pace], budget_ms: float) -> int:
    """Return the number of candidates, at most the configured one: as many as the workers manage.

    And no fewer than the optimizer can work with.

    Args:
        config: of the planner; its optimizer needs an elite more than it keeps, and each of its
            iterations a candidate.
        paces: of all workers, as measured.
        budget_ms: time until the plan must go out.
    """
    fewest = max(FEWEST, config.elites + 1, config.iterations)
    fits = int(RESERVE * sum(pace.rows_in(budget_ms) for pace in paces))
    return min(config.rollouts, max(fewest, fits))


def periods(paces: Collection[Pace], period_ms: float, margin_ms: float) -> int:
    """Return how many planning periods a plan may take: one, where rollouts are back in that.

    Where most of a period would go by on the way to the workers and back, plans are made less
    often and have rollouts, instead of none in time. The nearest workers that together have half
    of all pace count.

    Args:
        paces: of all workers, as measured.
        period_ms: wall time between plans [ms].
        margin_ms: of it that is kept for something else [ms].
    """
    nearest = sorted(paces, key=lambda pace: pace.wait_ms)
    half, reached, way = sum(pace.rows_per_ms for pace in nearest) / 2, 0.0, 0.0
    for pace in nearest:
        reached, way = reached + pace.rows_per_ms, pace.wait_ms
        if reached >= half:
            break
    return min(MOST_PERIODS, max(1, math.ceil((way + margin_ms) / period_ms + ROLLING)))
