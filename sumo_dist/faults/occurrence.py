"""A fault as it happened, and how long planning took to resume after it."""

from collections.abc import Sequence
from dataclasses import dataclass

from sumo_dist.faults.script import Fault


@dataclass
class Blow:
    """One fault as it happened.

    Attributes:
        fault: which.
        began, ended: wall time [s] of time.monotonic(); a killed service's fault ends when it is
            seen alive again.
        resumed: wall time at which the next good plan came; None if none did.
    """

    fault: Fault
    began: float
    ended: float | None = None
    resumed: float | None = None


def waited(blow: Blow, blows: Sequence[Blow], until: float | None) -> float | None:
    """Return how long planning took to resume once nothing was wrong any more [s].

    A fault that was active when this one ended, or began before planning resumed, is not this
    one's doing: the clock starts at the end of the last of them.

    Args:
        blow: the fault.
        blows: all of the run.
        until: when the run ended, for a fault after which planning did not resume; None if that
            is not known.

    Returns:
        The wait; None if the run ended before this fault or one that overlaps it was over, or
        nobody knows when.
    """
    resumed = until if blow.resumed is None else blow.resumed
    if blow.ended is None or resumed is None:
        return None
    start = blow.ended
    for other in blows:
        if other.began < resumed and (other.ended is None or other.ended > blow.ended):
            if other.ended is None:
                return 0.0 if blow.resumed is not None else None
            start = max(start, other.ended)
    return max(0.0, resumed - start)
