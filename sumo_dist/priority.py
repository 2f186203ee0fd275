"""Who goes first on a machine whose cores are all at work: what the robot waits for, not rollouts.

A core that rolls out is given back a time slice late, and a robot's reading is an answer only after
four such hand-overs (decision 0011).
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sumo_dist.errors import unknown

VARIABLE = "SUMO_DIST_PRIORITY"
CHOICES = ("real-time", "normal")
RANK = 10  # of SCHED_RR, which has 1 to 99: before all that is normal, behind what drives hardware
NICENESS = 10
AUTOGROUP = Path("/proc/self/autogroup")
PATIENCE_S = 2.0  # for the turn of many workers that start at once


def go_first() -> bool:
    """Give this thread and those it starts real-time priority; return whether that is permitted.

    Raises:
        UsageError: the environment asks for a priority that there is not.
    """
    choice = os.environ.get(VARIABLE, CHOICES[0])
    if choice not in CHOICES:
        raise unknown(VARIABLE, choice, CHOICES)
    if choice == "normal" or not hasattr(os, "sched_setscheduler"):
        return False
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(RANK))
    return goes_first()


@contextmanager
def going_first() -> Iterator[bool]:
    """Go first for a while, this thread and those it starts; yield whether that is permitted."""
    before = goes_first()
    first = go_first()
    try:
        yield first
    finally:
        if first and not before:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def goes_first() -> bool:
    """Whether this thread has real-time priority."""
    return hasattr(os, "sched_getscheduler") and os.sched_getscheduler(0) == os.SCHED_RR


def lower_priority() -> None:
    """Let the other services of this machine go before this process."""
    os.nice(NICENESS)
    # Linux may group processes by session, and then weighs niceness within one only. A worker of a
    # terminal shares its session with what else runs there, which must not become slower.
    deadline = time.monotonic() + PATIENCE_S
    while os.getsid(0) == os.getpid() and time.monotonic() < deadline:
        try:
            AUTOGROUP.write_text(str(NICENESS), encoding="ascii")
            return
        except BlockingIOError:  # of those without privileges one gets its turn in 0.1 s
            time.sleep(0.02)
        except OSError:
            return
