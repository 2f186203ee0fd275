"""What a worker is asked and has not answered yet, by all optimizers that it serves."""

import threading
import time
from collections import deque
from dataclasses import dataclass

from sumo_dist.wire.messages import RolloutRequest

ROWS = 4096  # of an asker that wait at a time, as many as a plan may have
ASKERS = 64  # that are served at a time
REMEMBERED_S = 10.0  # an asker that asks no more


@dataclass(frozen=True)
class _Waiting:
    """A request and when it came, time.monotonic(); `start` orders it among those of all askers."""

    request: RolloutRequest
    arrived: float
    start: float

    @property
    def rank(self) -> tuple[bool, int, float]:
        """Orders it among those that wait: what is least goes first."""
        return not self.request.reply_budget_ms, -self.request.priority, self.start

    @property
    def late(self) -> bool:
        """Whether an answer would be of no use any more."""
        budget = self.request.reply_budget_ms
        return budget > 0 and (time.monotonic() - self.arrived) * 1e3 > budget


class Inbox:
    """Requests still worth answering: those of each asker's newest plan, within their time.

    Those that have a deadline go first, then those of a higher priority. Among equals, every asker
    gets the same number of rows while it asks for more than its share (start-time fair queueing,
    Goyal 1996: a request starts when the asker's one before it would have ended if rows were the
    only clock). What an asker asks for beyond ROWS at a time is dropped, and so are askers beyond
    ASKERS.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._arrived = threading.Condition()
        self._waiting: dict[str, deque[_Waiting]] = {}  # by asker
        self._ends: dict[str, float] = {}  # where each asker's last request ends, in rows
        self._rows: dict[str, int] = {}  # that each asker waits for
        self._last: dict[str, tuple[float, RolloutRequest]] = {}  # when each asked, and for what
        self._now = 0.0  # where the request that was handed out last started

    def put(self, request: RolloutRequest) -> None:
        """Take a request; what its asker asked for an earlier plan or another run is forgotten."""
        plan = (request.run, request.number, request.iteration)
        with self._arrived:
            if not self._note(request):
                return
            waiting = self._waiting.get(request.asker, deque())
            if waiting:
                last = waiting[-1].request
                if (last.run, last.number, last.iteration) != plan:
                    if last.run == request.run and last.order > request.order:
                        return
                    self._ends[request.asker] = waiting[0].start  # what is dropped costs nothing
                    self._forget(request.asker)
                    waiting = deque()
            rows = self._rows.get(request.asker, 0) + len(request.knots)
            if rows > ROWS:
                return
            self._waiting[request.asker], self._rows[request.asker] = waiting, rows
            start = max(self._now, self._ends.get(request.asker, 0.0))
            self._ends[request.asker] = start + len(request.knots)
            waiting.append(_Waiting(request, time.monotonic(), start))
            self._arrived.notify()

    def _forget(self, asker: str) -> None:
        """Forget what an asker waits for: who has an entry waits for something."""
        del self._waiting[asker], self._rows[asker]

    def _note(self, request: RolloutRequest) -> bool:
        """Note who asks; return whether there is room for one more."""
        now = time.monotonic()
        if request.asker not in self._last and len(self._last) >= ASKERS:
            self._last = {a: s for a, s in self._last.items() if now < s[0] + REMEMBERED_S}
            if len(self._last) >= ASKERS:
                return False
        self._last[request.asker] = now, request
        return True

    def last(self, seconds: float) -> list[RolloutRequest]:
        """The last request of each asker that waits, or that has asked within some seconds."""
        since = time.monotonic() - seconds
        with self._arrived:
            return [
                request
                for asker, (at, request) in self._last.items()
                if at > since or self._waiting.get(asker)
            ]

    def get(self, timeout: float) -> RolloutRequest | None:
        """Return the next request, waiting up to timeout [s]."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._waiting), timeout)
            while self._waiting:
                heads = {asker: waiting[0] for asker, waiting in self._waiting.items()}
                asker = min(heads, key=lambda a: heads[a].rank)
                head = self._waiting[asker].popleft()
                self._rows[asker] -= len(head.request.knots)
                if not self._waiting[asker]:
                    self._forget(asker)
                if not head.late:
                    self._now = head.start
                    self._ends = {a: end for a, end in self._ends.items() if end > self._now}
                    return head.request
            return None
