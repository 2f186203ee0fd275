"""What the trials of a search came to: losses, the best, and what they cost."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sumo_dist.bench.tune.space import Values

Row = Mapping[str, Any]
STATES = RUNNING, COMPLETE, PRUNED = "running", "complete", "pruned"

LOSS = (
    "The loss of a trial is how many of its seeds are not solved, plus the mean over its seeds of "
    "the share of the time limit that they took, 1 where they are not solved: any more success is "
    "worth more than any time. All trials have the same seeds in the same order, so that a hard "
    "start costs all alike."
)


def loss(rows: Sequence[Row]) -> float:
    """Return the loss of a trial after some of its seeds, see LOSS; a fault is not solved.

    The search uses only which of two trials is better, so no scale between success and time has to
    be chosen. Between trials of equally many seeds the order is: success, then time.
    """
    unsolved = sum(not row["success"] for row in rows)
    shares = [
        min(row["completion_time_s"] / row["time_limit_s"], 1.0) if row["success"] else 1.0
        for row in rows
    ]
    return unsolved + sum(shares) / len(shares)


@dataclass(frozen=True)
class Tried:
    """A trial.

    Attributes:
        number: from 0 on, in the order in which they began.
        values: what it tried.
        rows: of its seeds so far.
        state: RUNNING, COMPLETE, or PRUNED before its last seed.
        cpu_s: CPU time of the search, of all trials, when its last row came [s].
    """

    number: int
    values: Values
    rows: Sequence[Row]
    state: str
    cpu_s: float

    @property
    def loss(self) -> float:
        """Of its seeds so far."""
        return loss(self.rows)

    @property
    def solved(self) -> int:
        """How many of its seeds are solved."""
        return sum(row["success"] for row in self.rows)


def tried(rows: Iterable[Row]) -> list[Tried]:
    """Sort the rows of a journal by trial."""
    by_number, spent, total = dict[int, list[Row]](), dict[int, float](), 0.0
    for row in rows:
        total += row["cpu_s"]
        by_number.setdefault(row["trial"], []).append(row)
        spent[row["trial"]] = total
    return [
        Tried(n, of_it[-1]["values"], of_it, of_it[-1]["state"], spent[n])
        for n, of_it in sorted(by_number.items())
    ]


def best(trials: Iterable[Tried]) -> Tried | None:
    """Return the complete trial of the least loss, the first of equal ones; None without any."""
    return min(
        (trial for trial in trials if trial.state == COMPLETE),
        key=lambda trial: (trial.loss, trial.number),
        default=None,
    )


def progress(trials: Iterable[Tried]) -> list[tuple[float, Tried]]:
    """Return CPU time [s] and the best trial until then, wherever there is a new best one."""
    found = list[tuple[float, Tried]]()
    for trial in sorted(trials, key=lambda trial: trial.cpu_s):
        if trial.state == COMPLETE and (not found or trial.loss < found[-1][1].loss):
            found.append((trial.cpu_s, trial))
    return found
