"""What is searched is what was asked for, and what cannot be is one line."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.bench.campaign.campaign import TrialSettings
from sumo_dist.bench.tune.space import Space, deciding
from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm
from sumo_dist.errors import UsageError
from sumo_dist.tasks import load_task, task_names

BOX = load_task("spot/move_box")

TASK = """
from dataclasses import replace
from sumo_dist import CostTerm, Parameter, load_task

def task():
    box = load_task("spot/move_box")
    term = CostTerm("lean", lambda r: abs(r.base.pos[..., 0] - r.p.lean[0]) * r.p.slope, -2.0)
    return replace(
        box, name="spot/leaning", cost=(*box.cost, term),
        parameters=(*box.parameters, Parameter("lean", (0.0, 0.5), "m"), Parameter("slope", 3.0)),
    )
"""


@pytest.fixture(scope="module")
def leaning(tmp_path_factory):
    """A task with a reward, and with parameters that only its cost reads."""
    path = tmp_path_factory.mktemp("task") / "leaning.py"
    path.write_text(TASK)
    return load_task(str(path))


def space(task=BOX, weights=(), **given):
    return Space.of(task, TrialSettings(**given), weights)


def ranges(found):
    return {d.name: (d.range.low, d.range.high, d.range.log) for d in found.dimensions}


def test_names_have_their_usual_range_and_others_what_is_said():
    found = space(weights=("goal",), weight=("gripper=1:9", "velocity=5"), set=("rollouts=8:32",))
    assert ranges(found) == {
        "weight goal": (6.0, 600.0, True),
        "weight gripper": (1.0, 9.0, True),
        "set rollouts": (8, 32, True),
    }
    assert found.start == {"weight goal": 60.0, "weight gripper": 4.0, "set rollouts": 16}
    assert found.has_start
    given = found.with_values({"weight goal": 70.5, "weight gripper": 2.0, "set rollouts": 9})
    assert given.weight == ("velocity=5", "goal=70.5", "gripper=2.0")
    assert given.set == ("rollouts=9",)
    assert given.episode("spot/move_box", 3).planner.rollouts == 9


def test_an_end_that_is_left_out_is_the_usual_one():
    found = space(weight=("goal=:100", "gripper=:"), set=("horizon=1:", "optimizer=ps:cem"))
    assert ranges(found)["weight goal"] == (6.0, 100.0, True)
    assert ranges(found)["weight gripper"] == (0.4, 40.0, True)
    assert ranges(found)["set horizon"] == (1.0, 3.0, False)
    assert found.dimensions[-1].range.choices == ("ps", "cem")
    assert not space(weight=("goal=70:100",)).has_start


def test_parameters_of_the_cost_can_be_searched_number_by_number(leaning):
    found = space(leaning, ("lean",), param=("lean=-1:1", "slope=1:5"))
    assert ranges(found) == {
        "weight lean": (-20.0, -0.2, True),
        "param lean[0]": (-1.0, 1.0, False),
        "param lean[1]": (-1.0, 1.0, False),
        "param slope": (1.0, 5.0, False),
    }
    given = found.with_values({**found.start, "param lean[1]": 0.25})
    assert given.param == ("lean=0.0,0.25", "slope=3.0")
    assert given.weight == ("lean=-2.0",)


def test_values_are_round_and_in_their_range():
    (goal, horizon), text = space(weights=("goal",), set=("horizon=0.5:1",)).dimensions, "goal"
    assert goal.name.endswith(text)
    assert goal.rounded(73.218374) == 73.22
    assert (goal.rounded(5.9999), goal.rounded(600.02)) == (6.0, 600.0)
    for asked in np.linspace(0.5, 1.0, 23):
        value = horizon.rounded(asked)
        assert replace(TrialSettings(), set=(f"horizon={value}",)).episode("spot/move_box", 0)


@pytest.mark.parametrize("name", task_names())
def test_what_decides_success_is_known_of_every_task(name):
    task = load_task(name)
    named = {*task.table.parameters}
    assert {p for p in named if p.startswith("success_") or p == "goal"} <= deciding(task) <= named


def test_what_only_the_cost_reads_decides_nothing(leaning):
    assert not {"lean", "slope"} & deciding(leaning)
    box = replace(BOX, parameters=(*BOX.parameters, Parameter("idle", 1.0)))
    assert "idle" not in deciding(box)


@pytest.mark.parametrize(
    ("weights", "given", "said"),
    [
        ((), {}, "nothing is searched: name weights, as in --weights goal,gripper, or give ranges"),
        (("gaol",), {}, "unknown cost term 'gaol'; valid: fall, goal, gripper, velocity"),
        (("goal", "goal"), {}, "weight goal is searched twice; once is valid"),
        (("goal",), {"weight": ("goal=1:2",)}, "weight goal is searched twice"),
        (("goal",), {"weight": ("goal=3",)}, "--weight goal=3 is fixed, and it is searched too"),
        ((), {"weight": ("goal=9:3",)}, "range 'goal=9:3': its ends must be numbers with LOW < HI"),
        ((), {"weight": ("goal=3:3",)}, "range 'goal=3:3': its ends must be numbers with LOW < HI"),
        ((), {"weight": ("goal=a:3",)}, "range 'goal=a:3': its ends must be numbers"),
        ((), {"weight": ("goal=1:2:3",)}, "range 'goal=1:2:3': its ends must be numbers"),
        ((), {"weight": ("goal=1:inf",)}, "range 'goal=1:inf': its ends must be numbers"),
        ((), {"weight": ("=1:2",)}, "--weight '=1:2' is not NAME=LOW:HIGH"),
        ((), {"param": ("success_radius=0.1:1",)}, "decides where spot/move_box starts or when it"),
        ((), {"param": ("goal=0:1",)}, "parameter goal decides where spot/move_box starts"),
        ((), {"param": ("lean=0:1",)}, "unknown parameter 'lean'"),
        ((), {"set": ("rollouts=0:8",)}, "rollouts must be from 1 to 4096, got 0"),
        ((), {"set": ("rollouts=2:8.5",)}, "range 'rollouts=2:8.5': its ends must be whole numb"),
        ((), {"set": ("rolouts=2:8",)}, "unknown setting 'rolouts'; valid: base_noise"),
        ((), {"set": ("nodes=1:8",)}, "a smooth spline needs at least 3 nodes, got 1"),
        ((), {"set": ("optimizer=ps",)}, "nothing is searched"),
        ((), {"set": ("optimizer=ps:ps",)}, "choices 'optimizer=ps:ps': give two or more differ"),
        ((), {"set": ("optimizer=ps:sgd",)}, "unknown optimizer 'sgd'; valid: cem, cma, icem, mp"),
        ((), {"set": ("timestep=0.01:fast",)}, "choices 'timestep=0.01:fast': give two or more"),
    ],
)
def test_what_cannot_be_searched_is_one_line(weights, given, said):
    with pytest.raises(UsageError) as caught:
        space(weights=weights, **given)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_weight_of_nothing_is_searched_from_nothing():
    off = CostTerm("off", BOX.cost[0].residual, 0.0)
    found = space(replace(BOX, cost=(*BOX.cost, off)), ("off",), weight=())
    assert ranges(found) == {"weight off": (0.0, 10.0, False)}
