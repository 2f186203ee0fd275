"""Good tasks pass every check; a task with one fault fails the check that is there for it."""

import re

import numpy as np
import pytest

from sumo_dist.check.checks import CHECKS, findings
from sumo_dist.check.subject import Subject
from sumo_dist.math.rotations import rotate
from sumo_dist.model.index import StateIndex
from sumo_dist.model.settle import height_above_floor
from sumo_dist.tasks import load_task, task_names

# Those that start processes and take times have tests of their own.
QUICK = {name: check for name, check in CHECKS.items() if name not in ("identity", "speed")}
FAULTY = """
from dataclasses import replace
import numpy as np
from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.model.frames import FrameRef
from sumo_dist.tasks import load_task, terms
from sumo_dist.tasks.task import Goal

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

def thrown(rng, start):
    state = BOX.reset(rng, start)
    state[start.index.velocity("box")] = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    return state

def goal_at(x, y, z=0.254, **more):
    goal = Parameter("goal", (x, y), "m")
    others = BOX.parameters[1:]
    return replace(BOX, parameters=(goal, *others), goal=Goal("object", z), **more)

def on_the_robot(rng, start):
    state = BOX.reset(rng, start)
    state[start.index.pose("box")][:2] = state[start.index.pose("body")][:2] + [0.6, 0.0]
    return state

def term(function, weight=1.0, **more):
    return replace(BOX, cost=(*BOX.cost, CostTerm("mine", function, weight, **more)))

def of_the_batch(r):
    return r.object.pos[..., 0] + r.object.pos[..., 0].mean(axis=0)
"""


def examined(tmp_path, expression):
    path = tmp_path / "mine.py"
    path.write_text(FAULTY + f"\n\ndef task():\n    return {expression}\n")
    return dict(findings(Subject(load_task(str(path)), 2), QUICK))


# Terms that act once a thing is gripped or stands, or no more once the robot is near it.
LATE = {
    "spot/demo_tire_upright": "spin, hands off",
    "spot/demo_barrier_upright": "grasp, spin, hands off",
    "spot/demo_cone_upright": "standoff",
    "spot/demo_chair_upright": "standoff",
    "spot/demo_tire_stack": "hands off",
    "spot/demo_barrier_drag": "grasp",
    "spot/demo_rack_drag": "grasp",
}


@pytest.mark.parametrize("name", task_names())
def test_a_task_of_ours_passes(name):
    found = dict(findings(Subject(load_task(name), 2), QUICK))
    if name in LATE:
        finding = found.pop("sensitive")
        assert (finding.level, finding.text.rpartition(": ")[2]) == ("warn", LATE[name])
    assert {name: f.text for name, f in found.items() if f.level != "ok"} == {}


@pytest.mark.parametrize(
    ("expression", "name", "reason"),
    [
        ("replace(BOX, reset=without_seed)", "reset", "a second draw differs"),
        ("replace(BOX, reset=one_start)", "reset", "every seed has the same start"),
        ("replace(BOX, reset=no_start)", "reset", "no acceptable reset in 1000 draws"),
        ("replace(BOX, reset=lambda rng, start: np.zeros(3))", "reset", r"shape \(3,\), must be"),
        ("replace(BOX, reset=changed(0, np.nan))", "reset", r"mine.py, line \d+: .*not finite"),
        ("replace(BOX, reset=changed(0, 2000.0))", "start", "2000 m away; positions are in m"),
        ("replace(BOX, reset=changed(3, 2.0))", "start", "quaternion has norm 2"),
        ("replace(BOX, reset=changed(2, 0.2))", "start", "overlap by 54 mm"),
        ("replace(BOX, reset=on_the_robot)", "start", "box (overlap|touch)"),
        ("replace(BOX, success=lambda r: r.object.pos[..., 2] > 0.2)", "unsolved", "success holds"),
        ("replace(BOX, success=lambda r: r.object.pos > 9)", "unsolved", r"shape \(1, 1, 3\)"),
        ("replace(BOX, success=lambda r: norm(r.object.pos))", "unsolved", "must be bool"),
        (
            "replace(BOX, success=lambda r: r.lid.pos)",
            "unsolved",
            r"^success: mine.py, line \d+: unk",
        ),
        ("replace(BOX, reset=changed(2, 0.7))", "rest", "box drops by 446 mm"),
        ("replace(BOX, reset=thrown)", None, ""),
        ("goal_at(1.0, 2.0)", None, ""),
        ("goal_at(50.0, 0.0)", "goal", "is 50 m away"),
        ("goal_at(1.0, 0.0, 0.6)", "goal", "put there, box drops by"),
        ("goal_at(1.0, 0.0, 0.1)", "goal", "box is 154 mm inside the floor"),
        ("goal_at(12.0, 0.0)", "goal", "makes the failure 'left the workspace' hold"),
        (
            "goal_at(1.0, 0.0, success=lambda r: norm(r.object.pos) < 0.1)",
            "goal",
            "success does not hold while object rests there",
        ),
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
        (
            "term(lambda r: norm(r.lid.pos))",
            "finite",
            r"^cost term 'mine': mine.py, line \d+: unknown frame 'lid'; valid: .*aim",
        ),
        (
            "term(terms.distance('gripp', 'object'))",
            "finite",
            r"^cost term 'mine': mine.py, line \d+: unknown frame 'gripp'; valid: .*gripper",
        ),
        ("term(lambda r: norm(r.object.pos)[:, 0])", "finite", r"line \d+: returned shape"),
        ("term(lambda r: 1 / 0)", "finite", r"line \d+: ZeroDivisionError"),
        ("term(lambda r: r.object.z[..., 2] * 1e-5)", "sensitive", "mine varies by .* nothing"),
        ("term(lambda r: np.abs(1 - norm(r.object.z)))", "sensitive", "mine varies by .* nothing"),
        ("term(lambda r: np.abs(1 - r.object.z[..., 2]))", None, ""),
        ("term(lambda r: norm(r.object.pos) > 99, reduction='any')", None, ""),
        ("term(of_the_batch)", "split", "mine depends on the other rows"),
    ],
)
def test_a_fault_fails_its_check(expression, name, reason, tmp_path):
    found = examined(tmp_path, expression)
    failed = [name for name, finding in found.items() if finding.level == "fail"]
    assert failed[:1] == ([name] if name else [])
    if name:
        assert re.search(reason, found[name].text)


def test_a_term_that_never_moved_is_said(tmp_path):
    found = examined(tmp_path, "term(lambda r: 0.0 * norm(r.object.pos))")["sensitive"]
    assert found.level == "warn"
    assert found.text.endswith("so of use later or never: mine")


@pytest.mark.parametrize(
    "expression",
    [
        "term(terms.distance('gripp', 'object'))",
        "replace(BOX, success=lambda r: 1 / 0)",
        "replace(BOX, reset=lambda rng, start: [][3])",
    ],
)
def test_one_cause_is_said_once(expression, tmp_path):
    found = examined(tmp_path, expression).values()
    (cause,) = (finding for finding in found if finding.level == "fail")
    assert re.search(r"mine.py, line \d+: ", cause.text)
    assert all(len(finding.text) < 20 for finding in found if finding.level == "skip")


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
