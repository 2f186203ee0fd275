"""A run of one process that somebody or something ends, and signals that come very early."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

from sumo_dist.record.recording import Recording

KEPT = "a run of one process that is not kept"
LONG = (
    *("run", "spot/move_box", "--workers", "0", "--viewer", "none", "--threads", "1"),
    *("--set", "rollouts=4", "--set", "horizon=0.4", "--out", "run"),
)


@contextlib.contextmanager
def started(folder, *words, ignored=(), **options):
    """A process of sumo-dist, which is killed if it does not end by itself."""

    def signals():
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs ignore it
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)

    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "sumo_dist", *map(str, words)],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=signals,  # noqa: PLW1509
        **options,
    )
    try:
        yield process
    finally:
        process.kill()
        for stream in (process.stdout, process.stderr):
            if stream is not None:
                stream.close()
        process.wait()


def repeats(ask, brought, folder):
    """What was kept is a whole recording."""
    ask(KEPT, brought, "replay", folder / "run", "--verify", code=0, says="to the last bit")


SIGNALS = {
    "Ctrl-C": [signal.SIGINT],
    "a terminal that is closed: HUP twice, then TERM": [
        *(signal.SIGHUP, signal.SIGHUP, signal.SIGTERM)
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("brought", SIGNALS)
def test_what_ends_a_run_leaves_it_whole(ask, tmp_path, brought):
    with started(tmp_path, *LONG) as process:
        assert "cost" in process.stderr.readline()  # the first plan is made
        for number in SIGNALS[brought]:
            process.send_signal(number)
        assert process.wait(60) == 130
        assert "not solved: interrupted" in process.stdout.read()
        assert "Traceback" not in process.stderr.read()
    repeats(ask, brought, tmp_path)


@pytest.mark.slow
def test_a_hangup_that_is_ignored_ends_nothing(ask, tmp_path):
    with started(tmp_path, *LONG, "--time-limit", "1", ignored=[signal.SIGHUP]) as process:
        assert "cost" in process.stderr.readline()
        process.send_signal(signal.SIGHUP)
        assert process.wait(60) == 1
        assert "not solved: timeout" in process.stdout.read()
    repeats(ask, "HUP under nohup", tmp_path)


@pytest.mark.slow
def test_readers_that_go_away_end_nothing(ask, tmp_path):
    with started(tmp_path, *LONG, "--time-limit", "4.2") as process:
        for name in ("stdout", "stderr"):
            getattr(process, name).close()
            setattr(process, name, None)
        assert process.wait(120) == 1  # the run's own code
    assert len(Recording.load(tmp_path / "run" / "run.npz").states) == 211
    repeats(ask, "nobody reads it any more", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("wait", [0.0, 0.15, 0.5])
def test_ctrl_c_while_a_command_is_being_loaded_is_quiet(tmp_path, wait):
    """At any moment from when the command line is being imported, whatever is imported then."""
    verbose = {**os.environ, "PYTHONVERBOSE": "1"}
    with started(tmp_path, *LONG, env=verbose) as process:
        while "cli.py" not in process.stderr.readline():  # it is being imported
            assert process.poll() is None
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
        assert process.wait(60) == 130
        assert "Traceback" not in said, said[-2000:]
