"""A line now and then, so that a long run is seen to go on."""

from collections.abc import Callable, Sequence

from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import TICK

EVERY_TICKS = 100  # two seconds of robot time


class Progress:
    """Says how a run goes, from its plans."""

    def __init__(self, terms: Sequence[str], tell: Callable[[str], None]) -> None:
        """Name the cost terms, and where the lines go."""
        self._terms, self._tell, self._next = terms, tell, 0

    def __call__(self, report: PlanReport) -> None:
        """Take note of a plan."""
        if report.plan.tick < self._next:
            return
        self._next = report.plan.tick + EVERY_TICKS
        costs = ", ".join(f"{n} {c:.1f}" for n, c in zip(self._terms, report.terms, strict=True))
        time = f"{report.plan.tick * TICK:5.1f} s"
        self._tell(f"{time}  cost {report.terms.sum():.1f} ({costs}), plan {report.plan_ms:.0f} ms")
