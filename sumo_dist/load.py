"""How much of this machine's cores programs use that are not of the same run."""

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_PROC = Path("/proc")
_PARENT, _USER, _SYSTEM = 1, 11, 12  # fields of /proc/PID/stat after the command
_BUSY = (0, 1, 2, 5, 6)  # user, nice, system, irq, softirq among the times of a core


class OtherLoad:
    """Measures between two calls.

    Of this run are this process, the one that has started it, and all that these have started. A
    service that was started by hand has a shell for its parent, and counts what runs there as its
    own.
    """

    def __init__(self) -> None:
        """Start measuring."""
        self._before = _times()
        self._at = time.monotonic()

    def used(self) -> float | None:
        """Return cores that others have used on average since the last call; None if unknown."""
        before, self._before = self._before, _times()
        began, self._at = self._at, time.monotonic()
        if before is None or self._before is None or self._at == began:
            return None
        (cores_before, ours_before), (cores_now, ours_now) = before, self._before
        ours = sum(now - ours_before.get(pid, 0.0) for pid, now in ours_now.items())
        return max(0.0, (cores_now - cores_before - ours) / (self._at - began))


def _times() -> tuple[float, dict[int, float]] | None:
    """Core seconds used on the cores of this process, and by each process of this run."""
    if not hasattr(os, "sched_getaffinity"):
        return None
    try:
        lines = (_PROC / "stat").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    per_second = os.sysconf("SC_CLK_TCK")
    mine = {f"cpu{core}" for core in os.sched_getaffinity(0)}
    used = [line.split()[1:] for line in lines if line.split()[:1] and line.split()[0] in mine]
    total = sum(int(times[i]) for times in used for i in _BUSY) / per_second
    return total, {pid: ticks / per_second for pid, ticks in _of_this_run()}


def _of_this_run() -> Iterator[tuple[int, int]]:
    """Yield process and clock ticks of what the process that has started this one has started."""
    found: dict[int, tuple[int, int]] = {}  # process -> its parent, its ticks
    for path in _PROC.glob("[0-9]*/stat"):
        with suppress(OSError, ValueError, IndexError):
            fields = path.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
            ticks = int(fields[_USER]) + int(fields[_SYSTEM])
            found[int(path.parent.name)] = int(fields[_PARENT]), ticks
    run = {os.getpid(), os.getppid()} - {0, 1}  # a service of systemd has nobody's parent
    for pid, (_, ticks) in found.items():
        ancestor = pid
        while ancestor in found and ancestor not in run:
            ancestor = found[ancestor][0]
        if ancestor in run:
            run.add(pid)
            yield pid, ticks
