"""What a worker is asked and has not answered yet, by all optimizers that it serves."""

import threading
import time
from collections import deque
from dataclasses import dataclass

from sumo_dist.wire.messages import RolloutRequest


@dataclass(frozen=True)
class _Waiting:
    """A request and when it came, time.monotonic(); `start` orders it among those of all askers."""

    request: RolloutRequest
    arrived: float
    start: float

    @property
    def late(self) -> bool:
        """Whether an answer would be of no use any more."""
        budget = self.request.reply_budget_ms
        return budget > 0 and (time.monotonic() - self.arrived) * 1e3 > budget


class Inbox:
    """Requests still worth answering: those of each asker's newest plan, within their time.

    Those that have a deadline go first. Among the rest, and among themselves, every asker gets the
    same number of rows while it asks for more than its share (start-time fair queueing, Goyal 1996:
    a request starts when the asker's one before it would have ended if rows were the only clock).
    """

    def __init__(self) -> None:
        """Start empty."""
        self._arrived = threading.Condition()
        self._waiting: dict[str, deque[_Waiting]] = {}  # by asker
        self._ends: dict[str, float] = {}  # where each asker's last request ends, in rows
        self._now = 0.0  # where the request that was handed out last started

    def put(self, request: RolloutRequest) -> None:
        """Take a request; what its asker asked for an earlier plan or another run is forgotten."""
        plan = (request.run, request.number, request.iteration)
        with self._arrived:
            waiting = self._waiting.setdefault(request.asker, deque())
            if waiting:
                last = waiting[-1].request
                if (last.run, last.number, last.iteration) != plan:
                    if last.run == request.run and last.order > request.order:
                        return
                    self._ends[request.asker] = waiting[0].start  # what is dropped costs nothing
                    waiting.clear()
            start = max(self._now, self._ends.get(request.asker, 0.0))
            self._ends[request.asker] = start + len(request.knots)
            waiting.append(_Waiting(request, time.monotonic(), start))
            self._arrived.notify()

    def get(self, timeout: float) -> RolloutRequest | None:
        """Return the next request, waiting up to timeout [s]."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._waiting), timeout)
            while self._waiting:
                heads = {asker: waiting[0] for asker, waiting in self._waiting.items()}
                asker = min(
                    heads, key=lambda a: (not heads[a].request.reply_budget_ms, heads[a].start)
                )
                head = self._waiting[asker].popleft()
                if not self._waiting[asker]:
                    del self._waiting[asker]
                if not head.late:
                    self._now = head.start
                    self._ends = {a: end for a, end in self._ends.items() if end > self._now}
                    return head.request
            return None
