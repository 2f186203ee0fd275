import json
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager

import pytest

from sumo_dist.bench.results.journal import read_rows
from sumo_dist.cli import main
from sumo_dist.launch.launcher import listening

SMALL = ("--time-limit", "0.3", "--set", "rollouts=4", "--set", "horizon=0.1")
TIMING = ("cpu_s", "plan_ms_p50", "plan_ms_p99", "plan_cpu_ms", "plan_cpu_s", "real_time_factor")


def command(out, endpoint, *more):
    tasks = ("--tasks", "spot/move_box", "--out", str(out), "--listen", endpoint)
    return ["bench", "episodes", *tasks, *more]


@contextmanager
def trial_worker(endpoint, name, *more):
    """Yield a trial worker's process, and end it."""
    call = (sys.executable, "-m", "sumo_dist", "trial-worker", "--connect", endpoint)
    with subprocess.Popen([*call, "--name", name, "--jobs", "1", *more]) as process:
        try:
            yield process
        finally:
            process.terminate()


@contextmanager
def in_thread(*args):
    """Yield a list that gets the exit code of a command when it ends."""
    codes = []
    thread = threading.Thread(target=lambda: codes.append(main(list(args))), daemon=True)
    thread.start()
    yield codes
    thread.join(120)
    assert not thread.is_alive()


def wait_for(condition, patience=60.0):
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def rows(path):
    return [{k: v for k, v in row.items() if k not in TIMING} for row in read_rows(path)]


@pytest.mark.slow
def test_remote_workers_make_the_table_of_local_processes(tmp_path, capfd):
    """One worker is killed at work, one has another build; the rest do it all."""
    endpoint = listening("tcp/127.0.0.1:0")
    here, there = tmp_path / "here.jsonl", tmp_path / "there.jsonl"
    local = ("bench", "episodes", "--tasks", "spot/move_box", "--out", str(here))
    settings = ("--trials", "6", *SMALL, "--weight", "goal=80", "--param", "goal=1,0")
    assert main([*local, *settings]) == 0
    table = capfd.readouterr().out

    remote = command(there, endpoint, *settings, "--jobs", "0")
    with in_thread(*remote) as codes, ExitStack() as stack:
        stack.enter_context(trial_worker(endpoint, "portable", "--engine", "native-portable"))
        doomed = stack.enter_context(trial_worker(endpoint, "doomed"))
        wait_for(lambda: there.exists() and there.read_text().count("\n") >= 1)
        stack.enter_context(trial_worker(endpoint, "good"))
        doomed.send_signal(signal.SIGKILL)
        wait_for(lambda: codes)
    assert codes == [0]
    said = capfd.readouterr()
    assert said.out == table
    assert re.search(r"worker portable.0 gets no trials: its build is", said.err)
    assert "worker doomed.0 has left; its trial goes to another" in said.err
    assert sorted(rows(there), key=lambda r: r["seed"]) == sorted(
        rows(here), key=lambda r: r["seed"]
    )


@pytest.mark.slow
def test_a_worker_that_cannot_load_the_task_is_told_and_left_out(tmp_path, capfd):
    """A task of a file that the worker does not have: here, one that is gone once it is read."""
    endpoint = listening("tcp/127.0.0.1:0")
    task = tmp_path / "mine.py"
    task.write_text("from sumo_dist.tasks.spot.analysis import BOX, move\n\n\ndef task():\n"
                    "    return move(BOX)\n")  # fmt: skip
    out = tmp_path / "out.jsonl"
    call = ("bench", "episodes", "--tasks", str(task), "--out", str(out), "--listen", endpoint)
    with in_thread(*call, "--trials", "1", *SMALL, "--jobs", "0") as codes, ExitStack() as stack:
        wait_for(out.exists)
        text = task.read_text()
        task.unlink()
        stack.enter_context(trial_worker(endpoint, "without"))
        said = ""
        deadline = time.monotonic() + 60
        while "worker without.0 gets no trials: " not in said:
            said += capfd.readouterr().err
            assert time.monotonic() < deadline and not codes
            time.sleep(0.05)
        task.write_text(text)
        stack.enter_context(trial_worker(endpoint, "with"))
        wait_for(lambda: codes)
    assert codes == [0]
    assert len(json.loads(out.read_text())) > 10


def test_bad_endpoints_and_jobs_are_named(tmp_path, capsys):
    out = tmp_path / "out.jsonl"
    assert main(command(out, "loopback")) == 2
    assert "'loopback' is not an endpoint" in capsys.readouterr().err
    assert main(["trial-worker", "--jobs", "0"]) == 2
    assert "jobs must be from 1 to 256, got 0" in capsys.readouterr().err
