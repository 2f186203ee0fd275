import json

import numpy as np
import pytest

from sumo_dist.record.recording import Recording

KIND = "exceptions in a user's functions"
QUICK = (
    *("--viewer", "none", "--threads", "1", "--time-limit", "4"),
    *("--set", "rollouts=4", "--set", "horizon=0.4"),
)
CODE = """
T = move(DRUM)

def with_cost(residual):
    return replace(T, cost=(*T.cost, CostTerm("mine", residual, 1.0)))

def soon(r):
    {}
    return norm(r.object.pos)

def late(r):
    CALLS.append(1)
    if len(CALLS) > 20:  # past the plans that calibrate a realtime clock
        {}
    return norm(r.object.pos)

def never(r):
    return late(r) < 0.0
"""


def task_file(write_task, returns, statement="pass"):
    """Write a task of which one function runs a statement; return its path, and its line."""
    path = write_task(returns, CODE.format(statement, statement))
    lines = path.read_text().splitlines()
    return path, [i for i, line in enumerate(lines, 1) if line.strip() == statement]


@pytest.mark.parametrize(
    ("brought", "returns", "statement", "says"),
    [
        (
            "a cost divides by 0",
            "with_cost(soon)",
            "1 / 0",
            "cost term 'mine': .*ZeroDivisionError",
        ),
        ("a cost looks too far", "with_cost(soon)", "[][3]", "'mine': .*IndexError"),
        ("a cost exits", "with_cost(soon)", "sys.exit('no licence')", "SystemExit: no licence"),
        ("a cost without end", "with_cost(soon)", "soon(r)", "'mine': .*RecursionError"),
        (
            "a success raises",
            "replace(T, success=soon)",
            "int('x')",
            "^sumo-dist: success: .*ValueEr",
        ),
        (
            "a failure raises",
            "replace(T, failure={'wet': soon})",
            "r.lid",
            "failure 'wet': .*'lid'",
        ),
        (
            "a reset raises",
            "replace(T, reset=lambda rng, s: soon(s))",
            "{}['a']",
            "reset: .*KeyErr",
        ),
    ],
)
def test_before_the_run_it_is_one_line(ask, write_task, brought, returns, statement, says):
    path, (line, *_) = task_file(write_task, returns, statement)
    out = ask(KIND, brought, "run", path, "--workers", 0, *QUICK, code=2, says=says)
    assert len(out.splitlines()) == 1
    assert f"mine.py, line {line}: " in out


@pytest.mark.parametrize(
    ("brought", "returns", "says"),
    [
        (
            "a cost of another shape",
            "with_cost(lambda r: r.object.pos)",
            r"returned shape \(1, 20, 3",
        ),
        ("a cost of nothing", "with_cost(lambda r: None)", r"returned shape \(\)"),
        (
            "a cost in words",
            "with_cost(lambda r: np.full((1, 20), 'far'))",
            "returned <U3, must be num",
        ),
        ("a success of numbers", "replace(T, success=soon)", "success: .*float64, must be bool"),
        (
            "a reset of nothing",
            "replace(T, reset=lambda rng, s: None)",
            r"reset: .*shape \(\), must",
        ),
        (
            "a reset of nan",
            "replace(T, reset=lambda rng, s: s.place(np.full(2, np.nan), 0, {}))",
            "not f",
        ),
        (
            "a term that is never finite",
            "with_cost(lambda r: norm(r.object.pos) * np.nan)",
            "not finite",
        ),
    ],
)
def test_what_a_function_returns_is_checked(ask, write_task, brought, returns, says):
    path, _ = task_file(write_task, returns)
    code = 3 if "finite" in says else 2  # costs of rollouts may be infinite, now and then
    out = ask(KIND, brought, "run", path, "--workers", 0, *QUICK, code=code, says=says)
    assert "mine.py, line " in out


@pytest.mark.parametrize(
    ("brought", "text", "says"),
    [
        ("a file of bad syntax", "def task(:\n", "mine.py, line 1: SyntaxError"),
        (
            "an import of what is not there",
            "\nimport nowhere_at_all\n",
            "line 2: ModuleNotFoundError",
        ),
        (
            "a file that exits",
            "import sys\nsys.exit('set DATA first')\n",
            "line 2: SystemExit: set D",
        ),
        (
            "a file that interrupts",
            "raise KeyboardInterrupt\n",
            "mine.py, line 1: KeyboardInterrupt",
        ),
        ("a file without end", "def f():\n    f()\nf()\n", "mine.py, line 2: RecursionError"),
    ],
)
def test_a_file_that_raises_is_one_line(ask, tmp_path, brought, text, says):
    path = tmp_path / "mine.py"
    path.write_text(text)
    assert len(ask(KIND, brought, "task", "check", path, code=2, says=says).splitlines()) == 1


@pytest.mark.parametrize(
    ("brought", "returns", "statement", "says"),
    [
        ("a cost raises late", "with_cost(late)", "[][7]", "fault: cost term 'mine': .*IndexError"),
        ("a success exits late", "replace(T, success=never)", "sys.exit('out')", "SystemExit: out"),
        (
            *("a success interrupts late", "replace(T, success=never)"),
            *("raise KeyboardInterrupt", "fault: success: .*KeyboardInterrupt"),
        ),
    ],
)
def test_in_the_run_it_is_a_fault_and_the_run_is_kept(
    ask, write_task, tmp_path, brought, returns, statement, says
):
    path, (_, line) = task_file(write_task, returns, statement)
    out = tmp_path / "out"
    command = "run", path, "--workers", 0, "--out", out, *QUICK
    printed = ask(KIND, brought, *command, code=3, says=says)
    assert f"mine.py, line {line}: " in printed
    check_kept(out)


def check_kept(out):
    summary, recording = (
        json.loads((out / "summary.json").read_text()),
        Recording.load(out / "run.npz"),
    )
    assert summary["end"] == "fault" and "mine.py, line" in summary["end_reason"]
    assert summary["plans"] == len(recording.plan_numbers) >= 1
    assert len(recording.states) >= 2 and np.isfinite(recording.states[-1]).all()


@pytest.mark.slow
@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_workers_survive_it_and_the_robot_stops_at_once(ask, write_task, tmp_path, clock):
    """A robot that waited would wait for ten minutes, longer than the command may take."""
    path, _ = task_file(write_task, "with_cost(late)", "raise OSError('the disk is gone')")
    out = tmp_path / "out"
    printed = ask(
        *(KIND, f"a cost raises on every worker ({clock})", "run", path, "--workers", 2),
        *("--clock", clock, "--out", out, "--listen", "tcp/127.0.0.1:0", "--wait", 600, *QUICK),
        code=3,
        says=r"not solved: fault: cost term 'mine': mine.py, line \d+: OSError: the disk is gone",
        own_process=True,
    )
    assert "local-0 ended" not in printed and "local-1 ended" not in printed
    assert "is left out: cost term 'mine'" in printed
    check_kept(out)
    assert ("the robot sat down" in printed) == (clock == "realtime")


@pytest.mark.slow
def test_a_campaign_puts_it_down_to_the_task_and_goes_on(ask, write_task, tmp_path):
    returns = "replace(T, reset=lambda rng, start: soon(start))"
    path, _ = task_file(write_task, returns, "raise LookupError('no room')")
    printed = ask(
        *(KIND, "a campaign of two tasks, of which one raises", "bench", "episodes"),
        *("--tasks", f"{path},spot/move_box", "--trials", 1, "--out", tmp_path / "rows.json"),
        *("--jobs", 1, "--time-limit", "0.1", "--set", "rollouts=4", "--set", "horizon=0.4"),
        code=3,
        says=r"1 of 2 trials ended by a fault: reset: mine.py, line \d+: LookupError: no room",
    )
    assert "died" not in printed
    rows = [json.loads(line) for line in (tmp_path / "rows.json").read_text().splitlines()]
    assert {(row["task"] == "spot/move_box", row["end"]) for row in rows} == {
        (True, "timeout"),
        (False, "fault"),
    }
