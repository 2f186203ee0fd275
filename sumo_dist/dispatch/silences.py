"""Telling people of workers that do not answer: a few lines at most, then how often it was."""

import threading
import time
from collections import Counter
from collections.abc import Callable

from sumo_dist.wire.events import Tell

WINDOW_S = 30.0  # of the first sum; each that follows on it is of twice the time
LONGEST_S = 480.0
LINES = 2  # silences that are told one by one in a window; of more than that only a sum is told


class Silences:
    """The silences of all workers of an optimizer. Its methods may be called on any thread."""

    def __init__(self, tell: Tell, explained: Callable[[], bool]) -> None:
        """Start with all answering.

        Args:
            tell: speaks to people.
            explained: people know already why workers do not answer, so only sums are told.
        """
        self._tell, self._explained = tell, explained
        self._lock = threading.Lock()
        self._until: float | None = None  # time.monotonic() of the window's end
        self._window = WINDOW_S
        self._lines = 0  # told one by one in the window
        self._told: set[str] = set()  # workers whose silence was told, and whose return will be
        self._counted: Counter[str] = Counter()
        self._silent: set[str] = set()

    def began(self, name: str) -> None:
        """Take note that a worker does not answer."""
        self.look()
        with self._lock:
            if self._until is None:
                self._until = time.monotonic() + self._window
            self._silent.add(name)
            if self._lines == LINES or self._explained():
                self._counted[name] += 1
                return
            self._lines += 1
            self._told.add(name)
        self._tell("warning", f"worker {name} does not answer: it is passed over")

    def ended(self, name: str) -> None:
        """Take note that a worker answers again."""
        with self._lock:
            self._silent.discard(name)
            told = name in self._told
            self._told.discard(name)
        if told:
            self._tell("info", f"worker {name} answers again")

    def left(self, name: str) -> None:
        """Take note that a worker has left, which others tell."""
        with self._lock:
            self._silent.discard(name)
            self._told.discard(name)

    def look(self) -> None:
        """Tell the sum if the window is over."""
        with self._lock:
            if self._until is None or time.monotonic() < self._until:
                return
            window, counted, now = self._window, self._counted, sorted(self._silent)
            self._until, self._lines, self._counted = None, 0, Counter()
            self._window = min(2 * window, LONGEST_S) if counted else WINDOW_S
        if counted:
            each = ", ".join(f"{name} {count}" for name, count in counted.most_common(4))
            more = f" and {len(counted) - 4} more" if len(counted) > 4 else ""
            still = f"; silent now: {', '.join(now[:4])}" if now else ""
            self._tell(
                "warning",
                f"{counted.total()} times in {window:g} s a worker did not answer: "
                f"{each}{more}{still}",
            )
