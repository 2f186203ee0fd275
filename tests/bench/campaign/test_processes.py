import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sumo_dist.bench.campaign.processes import Again, Processes, run_each
from sumo_dist.bench.layout import checked_engine
from sumo_dist.errors import UsageError

# A process imports what it runs by name, so the jobs here are functions that any of them has.

SLEEP = "import os, pathlib, time; pathlib.Path({!r}).write_text(str(os.getpid())); time.sleep(60)"
SLEEPER = """
from sumo_dist.bench.campaign.processes import Processes, run_each
with Processes(exec, 1) as pool:
    list(run_each([{!r}], [pool]))
"""


def each(function, jobs, limit=1):
    with Processes(function, limit) as pool:
        return list(run_each(jobs, [pool]))


def test_every_job_is_answered_once():
    assert sorted(each(abs, [-1, -2, -3], limit=2)) == [(-3, 3), (-2, 2), (-1, 1)]


def test_a_process_that_dies_is_told():
    assert each(os._exit, [5]) == [(5, None)]


def test_an_error_on_purpose_is_raised_here():
    with pytest.raises(UsageError, match="unknown engine 'diesel'; valid: auto"):
        each(checked_engine, ["diesel"])


def test_pools_share_the_jobs_and_a_lost_one_is_done_by_another():
    class Loser(Processes):
        def result(self, ours):
            super().result(ours)
            self._limit = 0
            raise Again

    with Loser(abs, 1) as loser, Processes(abs, 1) as other:
        assert sorted(run_each([-1, -2, -3], [loser, other])) == [(-3, 3), (-2, 2), (-1, 1)]
        assert loser.free == 0 and other.free == 1


@pytest.mark.parametrize("fate", [signal.SIGKILL, signal.SIGINT])
def test_jobs_end_with_who_asked_for_them(tmp_path, fate):
    note = tmp_path / "pid"
    source = SLEEPER.format(SLEEP.format(str(note)))
    with subprocess.Popen([sys.executable, "-c", source], stderr=subprocess.DEVNULL) as parent:
        wait_until(lambda: note.exists() and note.read_text())
        parent.send_signal(fate)
        parent.wait(10)
    wait_until(lambda: not Path(f"/proc/{note.read_text()}").exists())


def wait_until(condition, patience=20.0):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)
