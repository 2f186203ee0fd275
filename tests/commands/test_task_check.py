"""Good tasks pass every check; a task with one fault fails the check that is there for it."""

import re

import numpy as np
import pytest

from sumo_dist.cli import main
from sumo_dist.commands.task_check import CHECKS, Subject
from sumo_dist.math.rotations import rotate
from sumo_dist.model.index import StateIndex
from sumo_dist.model.settle import height_above_floor
from sumo_dist.tasks import load_task

FAULTY = """
from dataclasses import replace
import numpy as np
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.model.frames import FrameRef
from sumo_dist.tasks import load_task

BOX = load_task("spot/move_box")

def without_seed(rng, start):
    return BOX.reset(np.random.default_rng(), start)

def one_start(rng, start):
    return BOX.reset(np.random.default_rng(0), start)

def no_start(rng, start):
    from sumo_dist.tasks.reset import redraw
    return redraw(lambda: None, lambda state: False)

def changed(part, value):
    def reset(rng, start):
        state = BOX.reset(rng, start)
        state[start.index.pose("box")][part] = value
        return state
    return reset

def on_the_robot(rng, start):
    state = BOX.reset(rng, start)
    state[start.index.pose("box")][:2] = state[start.index.pose("body")][:2] + [0.6, 0.0]
    return state

def term(function, weight=1.0, **more):
    return replace(BOX, cost=(*BOX.cost, CostTerm("mine", function, weight, **more)))

def of_the_batch(r):
    return r.object.pos[..., 0] + r.object.pos[..., 0].mean(axis=0)
"""


def check(tmp_path, capsys, expression):
    path = tmp_path / "mine.py"
    path.write_text(FAULTY + f"\n\ndef task():\n    return {expression}\n")
    code = main(["task", "check", str(path), "--seeds", "2"])
    lines = capsys.readouterr().out.splitlines()
    verdicts = (re.match(r"(ok|FAIL) +(\w+) +(.*)", line) for line in lines)
    return code, {found[2]: (found[1], found[3]) for found in verdicts if found}


@pytest.mark.parametrize("name", ["spot/move_rack", "spot/upright_tire", "g1/chair_push"])
def test_a_good_task_passes(name, capsys, monkeypatch):
    monkeypatch.setattr("sumo_dist.commands.task_check.COST_LIMIT", 10.0)  # the machine is shared
    assert main(["task", "check", name, "--seeds", "2"]) == 0
    out = capsys.readouterr().out
    assert out.count("\nok ") == len(CHECKS)
    assert "FAIL" not in out


@pytest.mark.parametrize(
    ("expression", "name", "reason"),
    [
        ("replace(BOX, reset=without_seed)", "reset", "a second draw differs"),
        ("replace(BOX, reset=one_start)", "reset", "every seed has the same start"),
        ("replace(BOX, reset=no_start)", "reset", "no acceptable reset in 1000 draws"),
        ("replace(BOX, reset=lambda rng, start: np.zeros(3))", "reset", r"shape \(3,\), must be"),
        ("replace(BOX, reset=changed(0, np.nan))", "start", "not finite"),
        ("replace(BOX, reset=changed(0, 2000.0))", "start", "2000 m away; positions are in m"),
        ("replace(BOX, reset=changed(3, 2.0))", "start", "quaternion has norm 2"),
        ("replace(BOX, reset=changed(2, 0.2))", "start", "overlap by 54 mm"),
        ("replace(BOX, reset=on_the_robot)", "start", "box (overlap|touch)"),
        ("replace(BOX, success=lambda r: r.object.pos[..., 2] > 0.2)", "unsolved", "success holds"),
        ("replace(BOX, success=lambda r: r.object.pos > 9)", "unsolved", r"\(1, 1, 3\) of bool"),
        (
            "replace(BOX, failure={'up': lambda r: r.base.pos[..., 2] > 0.4})",
            "unsolved",
            "up holds",
        ),
        (
            "replace(BOX, frames={**BOX.frames, 'lid': FrameRef('site', 'lid')})",
            "frames",
            r"lid \(site 'lid'\)",
        ),
        ("term(lambda r: np.log(-norm(r.object.pos)))", "finite", "mine is not finite in"),
        ("term(lambda r: norm(r.object.pos), 1e9)", "finite", "look at its weight or unit"),
        ("term(lambda r: norm(r.lid.pos))", "finite", "unknown frame 'lid'; valid: .*aim"),
        ("term(lambda r: norm(r.object.pos)[:, 0])", "finite", "returned shape"),
        ("term(lambda r: 1 / 0)", "finite", "ZeroDivisionError"),
        ("term(lambda r: 0.0 * norm(r.object.pos))", "sensitive", "mine varies by .* nothing"),
        ("term(lambda r: r.object.z[..., 2] * 1e-5)", "sensitive", "mine varies by .* nothing"),
        ("term(lambda r: np.abs(1 - norm(r.object.z)))", "sensitive", "mine varies by .* nothing"),
        ("term(lambda r: np.abs(1 - r.object.z[..., 2]))", None, ""),
        ("term(lambda r: norm(r.object.pos) > 99, reduction='any')", None, ""),
        ("term(of_the_batch)", "split", "mine depends on the other rows"),
    ],
)
def test_a_fault_fails_its_check(expression, name, reason, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sumo_dist.commands.task_check.COST_LIMIT", 10.0)
    code, findings = check(tmp_path, capsys, expression)
    failed = [name for name, (verdict, _) in findings.items() if verdict == "FAIL"]
    assert code == (1 if name else 0)
    if name is None:
        assert not failed
    else:
        assert failed[0] == name
        assert re.search(reason, findings[name][1])


def test_a_nudge_tilts_what_stands_and_leaves_it_on_the_floor():
    subject = Subject(load_task("g1/box_push"), 2)
    start, index = subject.starts[0], StateIndex(subject.plant)
    nudged = [subject.nudged(start, np.random.default_rng(seed)) for seed in range(8)]
    leans = [rotate(state[index.pose("box")][3:], np.array([0.0, 0.0, 1.0]))[2] for state in nudged]
    assert min(leans) < 0.98  # 11 deg
    assert min(leans) > 0.7
    for state in nudged:
        assert abs(height_above_floor(subject.plant, state[: subject.plant.nq], "box")) < 1e-3
        np.testing.assert_array_equal(state[index.pose("pelvis")], start[index.pose("pelvis")])
        assert state[index.velocity("box")].all()
    again = subject.nudged(start, np.random.default_rng(3))
    np.testing.assert_array_equal(again, nudged[3])


def test_a_task_that_plans_slowly_is_told(capsys, monkeypatch):
    monkeypatch.setattr("sumo_dist.commands.task_check.COST_LIMIT", 0.1)
    assert main(["task", "check", "spot/move_box", "--seeds", "2"]) == 1
    assert re.search(
        r"FAIL +speed +a planning iteration takes .*more than 0.1", capsys.readouterr().out
    )


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["task", "check", "spot/move_bx"], "unknown task 'spot/move_bx'; valid: .*spot/move_box"),
        (["task", "check", "nothing.py"], "nothing.py does not exist on this host"),
        (["task", "check", "spot/move_box", "--seeds", "1"], "seeds must be from 2 to 1000, got 1"),
        (["task", "chek"], "unknown command 'task chek'; valid: .*task check"),
        (["task"], "unknown command 'task'; valid: .*task check"),
    ],
)
def test_bad_usage_says_what_is_valid(arguments, reason, capsys):
    assert main(arguments) == 2
    assert re.search(reason, capsys.readouterr().err)
