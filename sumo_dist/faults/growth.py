"""How large the processes of a run are, from beginning to end: leaks show here."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from subprocess import Popen
from typing import NamedTuple

import numpy as np

LOOK_S = 0.25  # between two looks
GROWN_UP_S = 6.0  # younger processes still load what they need


class Size(NamedTuple):
    """A process at one instant.

    Attributes:
        at: time.monotonic() [s].
        mb: resident memory [MB].
        files: open file descriptors.
    """

    at: float
    mb: float
    files: int


@dataclass(frozen=True)
class Growth:
    """A service over its longest life.

    Attributes:
        service: its name.
        lives: processes it had.
        seconds: that it lived.
        mb, files: in the middle of that life and at its end, averaged over a tenth of it each.
    """

    service: str
    lives: int
    seconds: float
    mb: tuple[float, float]
    files: tuple[float, float]


class Census:
    """Looks at processes now and then."""

    def __init__(self) -> None:
        """Start without having seen any."""
        self._lives: dict[tuple[str, int], list[Size]] = {}
        self._looked = 0.0

    def look(self, processes: Mapping[str, "Popen[bytes]"]) -> None:
        """Note the size of each process by its service's name, if it is time to."""
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return
        self._looked = now
        for service, process in processes.items():
            if (size := _size(process.pid, now)) is not None:
                self._lives.setdefault((service, process.pid), []).append(size)

    def growths(self) -> list[Growth]:
        """Return how the services have grown; those that were never old enough are left out."""
        names = dict.fromkeys(service for service, _ in self._lives)
        found = []
        for name in names:
            lives = [sizes for (service, _), sizes in self._lives.items() if service == name]
            longest = max(lives, key=lambda sizes: sizes[-1].at - sizes[0].at)
            seconds = longest[-1].at - longest[0].at
            if seconds > GROWN_UP_S:
                mb, files = _middle_and_end(np.array(longest)[:, 1:])
                found.append(Growth(name, len(lives), round(seconds, 1), mb, files))
        return found

    def table(self) -> str:
        """Return all that was seen, as CSV."""
        lines = ["service,pid,at_s,rss_mb,files"]
        for (service, pid), sizes in self._lives.items():
            lines += [f"{service},{pid},{s.at:.2f},{s.mb:.2f},{s.files}" for s in sizes]
        return "\n".join(lines) + "\n"


def _middle_and_end(sizes: np.ndarray) -> list[tuple[float, float]]:
    """Means of each column of (N, 2) over a tenth of it, around its middle and at its end."""
    tenth = max(1, len(sizes) // 10)
    start = (len(sizes) - tenth) // 2
    middle, end = sizes[start : start + tenth].mean(axis=0), sizes[-tenth:].mean(axis=0)
    return [(round(float(m), 2), round(float(e), 2)) for m, e in zip(middle, end, strict=True)]


def _size(pid: int, now: float) -> Size | None:
    """Size of a process, None if it is gone."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        files = len(os.listdir(f"/proc/{pid}/fd"))
    except (OSError, IndexError):
        return None
    return Size(now, pages * os.sysconf("SC_PAGE_SIZE") / 1e6, files) if pages else None
