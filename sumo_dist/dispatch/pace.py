"""What a worker has shown to deliver, and in what time: rows per millisecond after a wait."""

from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

SAMPLES = 5  # answers; an odd number, so that a single one that was held up changes nothing
FORGET_S = 3.0  # a request unanswered for this long says nothing any more


class Pace(NamedTuple):
    """How soon a worker answers: after a wait, at a speed.

    Attributes:
        rows_per_ms: that it rolls out.
        wait_ms: that its answers take beside that: both ways, and what it does for others [ms].
        threads: that it rolls out with; rows that do not fill them cost as much as those that do.
    """

    rows_per_ms: float
    wait_ms: float = 0.0
    threads: int = 1

    def ready_ms(self, rows: int) -> float:
        """When so many rows are here [ms]."""
        full = -(-rows // self.threads) * self.threads
        return self.wait_ms + full / self.rows_per_ms

    def rows_in(self, ms: float) -> float:
        """Rows that are here after some time [ms]."""
        return self.rows_per_ms * max(0.0, ms - self.wait_ms)


@dataclass
class _Batch:
    """What a worker was asked for at once: when [s], and what it has computed of it so far [ms]."""

    plan: int
    sent: float
    computed_ms: float = 0.0


class Turnaround:
    """From a worker's requests to their answers, late ones too: those in time alone would flatter.

    Only times of this process's clock are compared. The median of the last few answers counts: a
    worker that was held up once would else get no rows, and be tried no sooner than in a second.
    """

    def __init__(self) -> None:
        """Start with no wait, until one is measured."""
        self._waits: deque[float] = deque(maxlen=SAMPLES)  # [ms]
        self._compiles = True
        self._batch: _Batch | None = None
        self._open: dict[int, _Batch] = {}  # by shard, oldest first

    @property
    def wait_ms(self) -> float:
        """What answers take beside their rollouts [ms]; 0 while nothing is measured."""
        return median(self._waits) if self._waits else 0.0

    def restart(self) -> None:
        """Do not count the next answer: it may have waited for the task to be compiled."""
        self._compiles = True

    def asked(self, plan: int, shard: int, now: float) -> None:
        """Note a request of some plan, now [s]."""
        if self._batch is None or self._batch.plan != plan:
            self._batch = _Batch(plan, now)
            while self._open and next(iter(self._open.values())).sent < now - FORGET_S:
                del self._open[next(iter(self._open))]
        self._open[shard] = self._batch

    def answered(self, shard: int, compute_ms: float, now: float) -> None:
        """Note an answer, which has come now [s]; only the first to a request counts."""
        batch = self._open.pop(shard, None)
        if batch is None:
            return
        batch.computed_ms += compute_ms
        if self._compiles:
            self._compiles = False
            return
        self._waits.append(max(0.0, (now - batch.sent) * 1e3 - batch.computed_ms))
