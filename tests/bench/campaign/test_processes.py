import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from sumo_dist.bench.campaign.processes import JobLost, processes
from sumo_dist.bench.layout import checked_engine
from sumo_dist.errors import TaskError, UsageError
from sumo_dist.tasks import load_task

# A process imports what it runs by name, so the jobs here are functions that any of them has.

SLEEP = "import os, pathlib, time; pathlib.Path({!r}).write_text(str(os.getpid())); time.sleep(60)"
SLEEPER = """
from sumo_dist.bench.campaign.processes import processes
with processes(exec, 1) as runners:
    list(runners.run_each([{!r}]))
"""


def each(function, jobs, limit=1):
    with processes(function, limit) as runners:
        return list(runners.run_each(jobs))


def test_every_job_is_answered_once():
    assert sorted(each(abs, [-1, -2, -3], limit=2)) == [(-3, 3), (-2, 2), (-1, 1)]


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs Linux")
def test_a_job_that_is_done_leaves_no_file_open():
    with processes(abs, 1) as runners:
        list(runners.run_each([-1]))
        gc.collect()
        before = len(os.listdir("/proc/self/fd"))
        list(runners.run_each([-1, -2, -3]))
        gc.collect()
        assert len(os.listdir("/proc/self/fd")) <= before


def test_no_thread_writes_the_environment_while_processes_start(monkeypatch):
    """A start fails now and then, with exit code 255, while another thread writes it."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    threads, on = [], True

    def note(event, _):
        if on and event in ("os.putenv", "os.unsetenv"):
            threads.append(threading.current_thread())

    sys.addaudithook(note)  # stays until this process ends
    assert each(os.getenv, ["MUJOCO_GL"] * 3, limit=2) == [("MUJOCO_GL", "disable")] * 3
    on = False
    assert threads == [threading.main_thread()] * 2
    assert "MUJOCO_GL" not in os.environ


def test_a_process_that_dies_is_told():
    assert each(os._exit, [5]) == [(5, None)]


def test_an_error_on_purpose_is_raised_here():
    with pytest.raises(UsageError, match="unknown engine 'diesel'; valid: auto"):
        each(checked_engine, ["diesel"])


def test_the_error_of_a_task_is_what_came_of_its_job(tmp_path):
    (tmp_path / "bad.py").write_text("raise ValueError('no')\n")
    ((_, result),) = each(load_task, [str(tmp_path / "bad.py")])
    assert isinstance(result, TaskError)
    assert "bad.py, line 1: ValueError: no" in str(result)


def test_a_lost_job_is_done_by_another_and_the_loser_gets_no_more():
    asked = []

    def loser(job):
        asked.append(job)
        raise JobLost

    with processes(abs, 1) as runners:
        runners.add(loser)
        assert sorted(runners.run_each([-1, -2, -3])) == [(-3, 3), (-2, 2), (-1, 1)]
    assert len(asked) <= 1


def test_a_runner_that_breaks_is_noticed():
    with processes(abs, 0) as runners, pytest.raises(ZeroDivisionError):
        runners.add(lambda job: job / 0)
        list(runners.run_each([1]))


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
