"""Which of a run's processes go before which; see tests/test_priority.py for how."""

import os
import subprocess
import sys

import pytest

from sumo_dist import priority

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(120),
    pytest.mark.skipif(
        not hasattr(os, "sched_setscheduler"), reason="only Linux has these priorities"
    ),
]


def permitted():
    """Whether this user may have real-time priority; asked in a process that may change its own."""
    code = "from sumo_dist import priority; print(priority.go_first())"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True
    )
    return done.stdout.split() == ["True"]


def test_what_the_robot_waits_for_goes_before_rollouts(run_system):
    system = run_system(workers=1, time_limit=20.0, give_way=True)
    system.after_plan(2)
    scheduled = {
        name: os.sched_getscheduler(process.pid) for name, process in system.processes.items()
    }
    first = os.SCHED_RR if permitted() else os.SCHED_OTHER
    for name in ("router", "state-estimator", "optimizer", "robot-interface"):
        assert scheduled[name] == first, name
    assert scheduled["local-0"] == os.SCHED_OTHER
    worker = system.processes["local-0"].pid
    assert os.getpriority(os.PRIO_PROCESS, worker) >= priority.NICENESS
