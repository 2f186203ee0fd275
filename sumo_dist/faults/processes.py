"""Faults of a living process besides signals: a full disk, the death of its children (Linux)."""

import os
import resource
import signal
from contextlib import suppress

from sumo_dist.errors import UsageError


def check_disks_can_fill() -> None:
    """Raise unless the files of another process can be kept from growing."""
    if not hasattr(resource, "prlimit"):
        raise UsageError("fault 'disk' needs prlimit, which only Linux has")


def fill_disk(pid: int) -> None:
    """Let no file that a process writes grow any more, as if the disk were full."""
    _limit_files(pid, 0)


def free_disk(pid: int) -> None:
    """Let its files grow again as those of this process may."""
    _limit_files(pid, resource.getrlimit(resource.RLIMIT_FSIZE)[0])


def children(pid: int) -> list[int]:
    """Return the living processes that a process has started."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{name}/stat", errors="replace") as file:
                stat = file.read()  # pid (name, which may hold anything) state parent ...
        except OSError:
            continue  # it has ended meanwhile
        state, parent = stat.rpartition(")")[2].split()[:2]
        if int(parent) == pid and state != "Z":
            found.append(int(name))
    return found


def kill_children(pid: int) -> None:
    """Kill what a process has started."""
    for child in children(pid):
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)


def _limit_files(pid: int, size: int) -> None:
    """Limit the size of the files that a process writes [bytes]."""
    _, hard_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    with suppress(ProcessLookupError):  # a process that has ended writes nothing
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, hard_limit))
