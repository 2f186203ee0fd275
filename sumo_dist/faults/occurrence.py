"""Faults as they happened, and how long planning took to resume after each."""

from collections.abc import Sequence
from dataclasses import dataclass

from sumo_dist.faults.script import Fault


@dataclass
class FaultOccurrence:
    """One fault as it happened; times are those of time.monotonic() [s].

    Attributes:
        fault: which.
        began, ended: a killed service's fault ends when the service is seen alive again.
        resumed: when the next good plan came; None if none did.
    """

    fault: Fault
    began: float
    ended: float | None = None
    resumed: float | None = None


def resume_delay(
    occurrence: FaultOccurrence, all_of_run: Sequence[FaultOccurrence], run_ended: float | None
) -> float | None:
    """Return how long planning took to resume once no fault was active any more [s].

    A fault that was active when this one ended, or began before planning resumed, delays planning
    as well: the time counts from the end of the last of them.

    Args:
        occurrence: the fault.
        all_of_run: all faults of the run.
        run_ended: counts as the time of resuming if planning never did; None if not known.

    Returns:
        The delay; None if the run ended before this fault or one that overlaps it was over, or if
        nothing tells when planning resumed.
    """
    resumed = run_ended if occurrence.resumed is None else occurrence.resumed
    if occurrence.ended is None or resumed is None:
        return None
    start = occurrence.ended
    for other in all_of_run:
        if other.began < resumed and (other.ended is None or other.ended > occurrence.ended):
            if other.ended is None:
                return 0.0 if occurrence.resumed is not None else None
            start = max(start, other.ended)
    return max(0.0, resumed - start)
