"""Telling people of workers that do not answer: a few lines at most, then how often it was."""

import threading
import time
from collections import Counter

from sumo_dist.wire.events import Tell

WINDOW_S = 30.0
LINES = 2  # silences that are told one by one in a window; of more than that only a sum is told


class Silences:
    """The silences of all workers of an optimizer. Its methods may be called on any thread."""

    def __init__(self, tell: Tell) -> None:
        """Start with all answering; `tell(level, text)` speaks to people."""
        self._tell = tell
        self._lock = threading.Lock()
        self._began = 0.0  # time.monotonic() of the window's first silence
        self._lines = 0  # told one by one in the window
        self._told: set[str] = set()  # workers whose silence was told, and whose return will be
        self._counted: Counter[str] = Counter()
        self._silent: set[str] = set()

    def began(self, name: str) -> None:
        """Take note that a worker does not answer."""
        self.look()
        with self._lock:
            if not self._lines:
                self._began = time.monotonic()
            self._silent.add(name)
            if self._lines == LINES:
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
            if not self._lines or time.monotonic() < self._began + WINDOW_S:
                return
            counted, self._counted, self._lines = self._counted, Counter(), 0
            now = sorted(self._silent)
        if counted:
            each = ", ".join(f"{name} {count}" for name, count in counted.most_common(4))
            more = f" and {len(counted) - 4} more" if len(counted) > 4 else ""
            still = f"; silent now: {', '.join(now[:4])}" if now else ""
            self._tell(
                "warning",
                f"workers did not answer {counted.total()} more times in {WINDOW_S:g} s: "
                f"{each}{more}{still}",
            )
