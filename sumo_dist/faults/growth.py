"""Memory and open files of a run's processes, from beginning to end, to find leaks."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from subprocess import Popen

import numpy as np

PERIOD_S = 0.25  # between two samples
WARM_UP_S = 6.0  # younger processes still load what they need


@dataclass(frozen=True)
class Growth:
    """A service over its longest life."""

    service: str
    lives: int  # processes it had
    seconds: float  # that the longest lived
    mb: tuple[float, float]  # resident memory in the middle of that life and at its end
    files: tuple[float, float]  # open files likewise; all averaged over a tenth of the life


class GrowthMonitor:
    """Samples the size of processes a few times a second (Linux)."""

    def __init__(self) -> None:
        """Start without samples."""
        # By service and process id; a sample is (time [s], memory [MB], open files).
        self._lives: dict[tuple[str, int], list[tuple[float, float, int]]] = {}
        self._sampled = 0.0

    def sample(self, processes: Mapping[str, "Popen[bytes]"]) -> None:
        """Note the size of each process, by its service's name, if it is time to."""
        now = time.monotonic()
        if now - self._sampled < PERIOD_S:
            return
        self._sampled = now
        for service, process in processes.items():
            size = _size(process.pid)
            if size is not None:
                self._lives.setdefault((service, process.pid), []).append((now, *size))

    def growths(self) -> list[Growth]:
        """Return how the services have grown, but for those that were never old enough."""
        found = []
        for name in dict.fromkeys(service for service, _ in self._lives):
            lives = [
                np.array(life) for (service, _), life in self._lives.items() if service == name
            ]
            longest = max(lives, key=lambda life: life[-1, 0] - life[0, 0])
            seconds = longest[-1, 0] - longest[0, 0]
            if seconds > WARM_UP_S:
                mb, files = _middle_and_end(longest[:, 1:])
                found.append(Growth(name, len(lives), round(float(seconds), 1), mb, files))
        return found

    def csv(self) -> str:
        """Return all samples."""
        lines = ["service,pid,at_s,rss_mb,files"]
        for (service, pid), life in self._lives.items():
            lines += [f"{service},{pid},{at:.2f},{mb:.2f},{files}" for at, mb, files in life]
        return "\n".join(lines) + "\n"


def _middle_and_end(sizes: np.ndarray) -> list[tuple[float, float]]:
    """Means of each column of (N, 2) over a tenth of it, around its middle and at its end."""
    tenth = max(1, len(sizes) // 10)
    start = (len(sizes) - tenth) // 2
    middle, end = sizes[start : start + tenth].mean(axis=0), sizes[-tenth:].mean(axis=0)
    return [(round(float(m), 2), round(float(e), 2)) for m, e in zip(middle, end, strict=True)]


def _size(pid: int) -> tuple[float, int] | None:
    """Resident memory [MB] and open files of a process; None if it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        files = len(os.listdir(f"/proc/{pid}/fd"))
    except (OSError, IndexError):
        return None
    return (pages * os.sysconf("SC_PAGE_SIZE") / 1e6, files) if pages else None
