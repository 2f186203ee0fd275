"""What the success of a campaign's trials cost: CPU time of their plans."""

import math
import statistics
from collections.abc import Iterable
from typing import NamedTuple, Self

from sumo_dist.bench.results.outcomes import Row
from sumo_dist.bench.results.stats import bootstrap_ratio

HEAD = ("CPU per plan [ms]", "CPU per solved [s]", "95 %")
NOTE = (
    "CPU time is that of all threads while they plan, without the simulated robot: of a plan, the "
    "median over trials of a trial's mean; per solved task, that of all trials over the number "
    "solved, with a bootstrap interval over the trials."
)


class Cost(NamedTuple):
    """CPU time of some trials.

    Attributes:
        plan_ms: of a plan, the median over trials of a trial's mean [ms].
        solved_s: of all trials over the number that succeeded [s]; infinite if none did.
        low, high: its 95 % interval [s].
    """

    plan_ms: float
    solved_s: float
    low: float
    high: float

    @classmethod
    def of(cls, rows: Iterable[Row]) -> Self | None:
        """Sum up the trials that say what they cost; None if there is none.

        Rows of journals of old do not say, nor trials that ended before their first plan.
        """
        told = [row for row in rows if row.get("plan_cpu_s") is not None]
        if not told:
            return None
        seconds = [row["plan_cpu_s"] for row in told]
        solved = sum(row["success"] for row in told)
        return cls(
            statistics.median(row["plan_cpu_ms"] for row in told),
            sum(seconds) / solved if solved else float("inf"),
            *bootstrap_ratio(seconds, [row["success"] for row in told]),
        )


def cost_cells(cost: Cost | None) -> tuple[str, ...]:
    """Return the cells under HEAD."""
    if cost is None:
        return ("-",) * len(HEAD)
    plan_ms, solved_s, low, high = cost
    if math.isinf(solved_s):
        return f"{plan_ms:.1f}", "none solved", "-"
    return f"{plan_ms:.1f}", f"{solved_s:.2f}", f"{low:.2f} to {high:.2f}"
