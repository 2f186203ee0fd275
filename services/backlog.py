"""What a tracer has heard and not shown yet."""

import threading
from collections import deque
from dataclasses import dataclass

from sumo_dist.wire.keys import Member
from sumo_dist.wire.messages import Message

BACKLOG = 2000  # messages; some ten seconds of a run


@dataclass(frozen=True)
class Presence:
    """A rollout worker has come or gone."""

    member: Member
    alive: bool


class Backlog:
    """What is still to be shown. When it is full the oldest is dropped: senders never wait."""

    def __init__(self, limit: int = BACKLOG) -> None:
        """Start empty."""
        self.dropped = 0
        self._items: deque[Message | Presence] = deque(maxlen=limit)
        self._changed = threading.Condition()

    def put(self, item: Message | Presence) -> None:
        """Append, at the cost of the oldest."""
        with self._changed:
            self.dropped += len(self._items) == self._items.maxlen
            self._items.append(item)
            self._changed.notify()

    def get(self, timeout: float) -> Message | Presence | None:
        """Return the oldest; None if there is nothing for `timeout` [s]."""
        with self._changed:
            self._changed.wait_for(lambda: self._items, timeout)
            return self._items.popleft() if self._items else None
