"""Folders of runs that begin together, and two runs with workers on one machine."""

import signal
import subprocess
import sys

import pytest

FOLDERS = "folders of runs"
TWO = "two runs on one machine"
QUICK = (
    *("--viewer", "none", "--threads", "1", "--set", "rollouts=4", "--set", "horizon=0.4"),
    *("--seed", "5", "--set", "variance_first=0.01", "--set", "variance_last=0.01"),  # they stand
)
ALONE = (*QUICK, "--workers", "0")


class Run:
    """A run in a process of its own."""

    def __init__(self, folder, *words):
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "sumo_dist", "run", *map(str, words)],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.said = ""

    def plans(self):
        """Wait for the first plan."""
        while "cost" not in (line := self.process.stderr.readline()):
            assert line, f"the run has ended: {self.said}"
            self.said += line

    def end(self):
        """Return exit code and the line at the end."""
        out, err = self.process.communicate(timeout=120)
        self.said += err
        return self.process.returncode, out


@pytest.fixture
def start(tmp_path):
    runs = []

    def start(*words):
        runs.append(Run(tmp_path, *words))
        return runs[-1]

    yield start
    for run in runs:
        if run.process.poll() is None:
            run.process.send_signal(signal.SIGINT)
            run.end()


@pytest.mark.slow
def test_runs_that_begin_at_once_have_a_folder_each(ask, start, tmp_path):
    short = ("spot/move_box", *ALONE, "--time-limit", "0.2")
    others = [start(*short) for _ in range(3)]
    one = ask(
        *(FOLDERS, "four runs started at once", "run", *short),
        code=1,
        says=r"; in runs/\d{8}-\d{6}-spot_move_box-5",
        own_process=True,
    )
    ends = [
        next(line for line in one.splitlines() if "; in " in line),
        *(run.end()[1].strip() for run in others),
    ]
    assert all("not solved: timeout, 4 plans" in end for end in ends)
    folders = {end.rpartition("; in ")[2] for end in ends}
    assert len(folders) == 4
    assert {str(p.parent.relative_to(tmp_path)) for p in tmp_path.rglob("run.npz")} == folders


@pytest.mark.slow
def test_a_folder_that_a_run_writes_to_is_not_given_to_another(ask, start, tmp_path):
    run = start("spot/move_box", *ALONE, "--out", "mine")
    run.plans()
    taken = ("run", "spot/move_box", *ALONE, "--out", tmp_path / "mine")
    says = "another run writes to .*mine: give this one another --out"
    ask(FOLDERS, "another run's --out", *taken, code=2, says=says)
    run.process.send_signal(signal.SIGINT)
    assert run.end()[0] == 130
    again = ("run", "spot/move_box", *ALONE, "--time-limit", "0.1", "--out", tmp_path / "mine")
    ask(FOLDERS, "the --out of a run that has ended", *again, code=1, says="; in .*mine$")


@pytest.mark.slow
def test_two_runs_at_once_are_found_told_apart_and_stopped(ask, start, tmp_path):
    spot = start("spot/move_box", *QUICK, "--workers", "1", "--out", "a")
    g1 = start("g1/box_push", *QUICK, "--workers", "1", "--out", "b")
    spot.plans()
    g1.plans()
    both = r"2 robots are here, choose one: --robot \w+ for .*; --robot \w+ for "
    ask(TWO, "both at work, none named", "resume", code=2, says=both)
    ask(TWO, "both at work, none named", "top", "--times", "1", code=2, says=both)
    ask(TWO, "one of them named", "ctl", "pause", "--robot", "g1", code=0, says=r"g1 .*: pause at")
    ask(
        *(TWO, "one of them named", "top", "--robot", "spot", "--times", "2"),
        code=0,
        says=r"^spot \(spot/move_box in a\): estimator main, optimizer .*, worker local-0$",
    )
    taken = next(r for r in (spot, g1) if "is taken: this run is at" in r.said)
    endpoint = taken.said.partition("this run is at ")[2].split()[0]
    third = ("run", "spot/move_box", *QUICK, "--workers", "1", "--out", tmp_path / "c")
    ask(
        *(TWO, "a third is given a port that is taken", *third, "--listen", endpoint),
        code=3,
        says=rf"cannot listen on {endpoint}: the port is taken, by \w+/\w+ in \w \(process \d+\)",
    )
    said = ask(TWO, "both at work, none named", "stop", code=0, says=r"spot .*: stop at tick \d+")
    assert "g1 (g1/box_push in b): stop at tick" in said
    for run in (spot, g1):
        code, line = run.end()
        assert code == 3
        assert "stopped by" in line
        assert "optimizers plan for it" not in run.said
