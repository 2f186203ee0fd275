"""What is worth trying can be tried, and holds what is there."""

import math
from dataclasses import replace

import pytest

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm
from sumo_dist.planner.config import PRESETS, PlannerConfig
from sumo_dist.planner.ranges import Range, parameter_ranges, setting_ranges, weight_ranges
from sumo_dist.planner.settings import SETTINGS
from sumo_dist.tasks import load_task, task_names


def values(found: Range) -> list[object]:
    """The ends, or all choices."""
    if found.kind == "choice":
        return [*found.choices]
    kind = int if found.kind == "int" else float
    return [kind(found.low), kind(found.high)]


@pytest.mark.parametrize("preset", PRESETS)
def test_every_setting_has_a_range_whose_values_are_valid(preset):
    config = PlannerConfig.preset(preset)
    found = setting_ranges(config)
    assert [*found] == [name for name in SETTINGS if name != "policy"]
    for name, useful in found.items():
        assert useful.name == name and useful.default == getattr(config, name) and useful.about
        for value in values(useful):
            assert type(value) is type(useful.default)
            assert getattr(config.changed({name: value}), name) == value


@pytest.mark.parametrize("name", task_names())
def test_ranges_of_a_task_hold_its_own_numbers(name):
    task = load_task(name)
    weights, parameters = weight_ranges(task), parameter_ranges(task)
    assert [*weights] == [term.name for term in task.cost]
    assert [*parameters] == [*task.table.parameters]
    numbers = [*weights.values(), *(n for several in parameters.values() for n in several)]
    numbers += [r for r in setting_ranges(PlannerConfig.resolve(task.planner)).values() if r.high]
    for number in numbers:
        assert number.low <= number.default <= number.high
        assert not number.log or number.low * number.high > 0


def test_a_setting_beyond_what_is_usual_widens_its_range():
    found = setting_ranges(PlannerConfig(rollouts=1000, horizon=0.2, timestep=0.001))
    assert (found["rollouts"].high, found["horizon"].low) == (1000, 0.2)
    assert 0.001 in found["timestep"].choices


def test_with_a_learned_policy_guidance_stays_as_it_is():
    found = setting_ranges(PlannerConfig(guidance="learned", policy="a.onnx"))
    assert found["guidance"].choices == ("learned",)


def test_weights_of_any_sign_and_open_parameters_have_ranges():
    task = load_task("spot/move_box")
    residual = task.cost[0].residual
    terms = [CostTerm("reward", residual, -3.0), CostTerm("off", residual, 0.0)]
    changed = replace(
        task,
        cost=(*task.cost, *terms),
        parameters=(*task.parameters, Parameter("open", (0.0, -4.0), "N")),
    )
    weights = weight_ranges(changed)
    assert (weights["reward"].low, weights["reward"].high) == (-30.0, -0.3)
    assert (weights["off"].low, weights["off"].log) == (0.0, False) and weights["off"].high > 0
    numbers = parameter_ranges(changed)["open"]
    assert all(math.isfinite(n.low) and n.low < n.default < n.high for n in numbers)
    assert numbers[0].unit == "N"
