"""Weights and parameters as data: names, sizes, ranges, and the texts they are changed by."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sumo_dist.costs.parameters import NO_PARAMETERS, Parameter
from sumo_dist.costs.table import CostSettings, CostTable
from sumo_dist.costs.terms import CostTerm
from sumo_dist.errors import UsageError

TERMS = (
    CostTerm("goal", lambda r: r.actions[..., 0], 60.0),
    CostTerm("reward", lambda r: r.actions[..., 0], -0.1),
)
PARAMETERS = (
    Parameter("radius", 0.1, "m", (0.0, 1.0)),
    Parameter("goal", (1.0, -2.0), "m", (-8.0, 8.0)),
    Parameter("angle", (0.5,)),
)


@pytest.fixture
def table():
    return CostTable(TERMS, PARAMETERS)


def numbers(settings):
    return settings.weights.tolist(), settings.parameters.tolist()


def test_the_defaults_are_in_the_declared_order(table):
    assert numbers(table.defaults) == ([60.0, -0.1], [0.1, 1.0, -2.0, 0.5])
    assert table.terms == ("goal", "reward")
    assert tuple(table.parameters) == ("radius", "goal", "angle")
    assert [p.size for p in PARAMETERS] == [1, 2, 1]


def test_numbers_have_names_and_the_shapes_of_their_defaults(table):
    p = table.named(np.array([0.2, 3.0, 4.0, 0.7]))
    assert p.radius == 0.2
    assert isinstance(p.radius, float)
    assert p.goal.tolist() == [3.0, 4.0]
    assert p.angle.tolist() == [0.7]
    with pytest.raises(UsageError, match="unknown parameter 'goat'; valid: angle, goal, radius"):
        _ = p.goat
    with pytest.raises(UsageError, match=r"unknown parameter 'goal'; valid: \(none\)"):
        _ = NO_PARAMETERS.goal


@pytest.mark.parametrize("name", ["", "two words", "2nd", "a-b", "_hidden", "a.b"])
def test_a_name_must_be_readable_as_an_attribute(name):
    with pytest.raises(UsageError, match="its name must be a Python identifier"):
        Parameter(name, 1.0)


@pytest.mark.parametrize("limits", [(1.0, 1.0), (2.0, 1.0), (np.nan, 1.0)])
def test_a_range_must_hold_something(limits):
    with pytest.raises(UsageError, match=r"parameter 'a': its range must be \(low, high\)"):
        Parameter("a", 1.0, range=limits)


@pytest.mark.parametrize(
    ("default", "reason"),
    [
        (2.0, "must be from 0 to 1 m, got 2.0"),
        (-0.1, "must be from 0 to 1 m"),
        ((0.5, 1.5), "must be from 0 to 1 m"),
        (np.nan, "needs a finite number, got nan"),
        ((0.5, np.inf), "needs 2 finite numbers"),
    ],
)
def test_a_default_is_checked_like_any_value(default, reason):
    with pytest.raises(UsageError, match=f"parameter 'a' {reason}"):
        Parameter("a", default, "m", (0.0, 1.0))


def test_both_ends_of_a_range_are_in_it(table):
    for value in (0.0, 1.0):
        assert table.with_parameter(table.defaults, "radius", value).parameters[0] == value


def test_two_parameters_of_one_name_are_refused():
    with pytest.raises(UsageError, match=r"distinct names, got \['a', 'a'\]"):
        CostTable(TERMS, (Parameter("a", 1.0), Parameter("a", 2.0)))


def test_a_change_leaves_all_else_and_the_defaults_as_they_were(table):
    changed = table.with_weight(table.defaults, "reward", -3.0)
    changed = table.with_parameter(changed, "goal", (0.0, 5.0))
    assert numbers(changed) == ([60.0, -3.0], [0.1, 0.0, 5.0, 0.5])
    assert numbers(table.defaults) == ([60.0, -0.1], [0.1, 1.0, -2.0, 0.5])
    assert not changed.same(table.defaults)
    assert changed.same(CostSettings(changed.weights.copy(), changed.parameters.copy()))


def test_texts_change_what_they_name(table):
    changed = table.adjusted(["goal=80", "reward= -1e-3"], ["goal=1,0", "radius=0.25"])
    assert numbers(changed) == ([80.0, -1e-3], [0.25, 1.0, 0.0, 0.5])
    again = table.adjusted(["goal=0"], [], changed)
    assert numbers(again) == ([0.0, -1e-3], [0.25, 1.0, 0.0, 0.5])


@pytest.mark.parametrize(
    ("weight", "param", "reason"),
    [
        (["gaol=1"], [], "unknown cost term 'gaol'; valid: goal, reward"),
        (["goal=nan"], [], "weight of 'goal' must be a finite number, got nan"),
        (["goal=inf"], [], "must be a finite number"),
        (["goal=1,2"], [], "weight 'goal=1,2' needs one number"),
        (["goal"], [], "weight 'goal' is not of the form name=number"),
        (["goal=much"], [], "is not of the form name=number"),
        (["goal="], [], "is not of the form name=number"),
        ([], ["gaol=1"], "unknown parameter 'gaol'; valid: angle, goal, radius"),
        ([], ["goal=1"], "parameter 'goal' needs 2 finite numbers, got"),
        ([], ["goal=1,2,3"], "parameter 'goal' needs 2 finite numbers"),
        ([], ["goal=1,nan"], "parameter 'goal' needs 2 finite numbers"),
        ([], ["radius=0.1,0.2"], "parameter 'radius' needs a finite number"),
        ([], ["radius=1.01"], "parameter 'radius' must be from 0 to 1 m"),
        ([], ["goal=9,0"], "parameter 'goal' must be from -8 to 8 m"),
        ([], ["goal=1,"], "param 'goal=1,' is not of the form name=number"),
        ([], ["=1"], "unknown parameter ''"),
    ],
)
def test_a_bad_text_says_what_is_valid(table, weight, param, reason):
    with pytest.raises(UsageError, match=reason):
        table.adjusted(weight, param)


finite = st.floats(-1e300, 1e300)
weights = arrays(float, 2, elements=finite)
values = st.tuples(st.floats(0, 1), st.floats(-8, 8), st.floats(-8, 8), finite).map(np.array)


@given(weights=weights, values=values)
def test_texts_say_every_bit_of_any_settings(weights, values):
    table = CostTable(TERMS, PARAMETERS)
    settings = CostSettings(weights, values)
    assert table.adjusted(*table.texts(settings)).same(settings)
    assert table.check(settings) is settings


def test_texts_name_only_what_differs(table):
    assert table.texts(table.defaults) == ((), ())
    changed = table.adjusted(["reward=0.25"], ["goal=0.5,-2"])
    assert table.texts(changed) == (("reward=0.25",), ("goal=0.5,-2.0",))


@pytest.mark.parametrize(
    ("weights", "parameters", "reason"),
    [
        (np.zeros(3), np.zeros(4), "have shapes ((3,), (4,)), this task's have ((2,), (4,))"),
        (np.zeros(2), np.zeros(3), "have shapes"),
        (np.zeros((2, 1)), np.zeros(4), "have shapes"),
        (np.zeros(2), np.array([2.0, 0, 0, 0]), "parameter 'radius' must be from 0 to 1 m"),
        (np.zeros(2), np.array([0.0, 0, np.nan, 0]), "parameter 'goal' needs 2 finite numbers"),
    ],
)
def test_settings_from_elsewhere_are_checked(table, weights, parameters, reason):
    with pytest.raises(UsageError, match=re.escape(reason)):
        table.check(CostSettings(weights, parameters))


def test_a_table_without_parameters():
    table = CostTable(TERMS, ())
    assert table.defaults.parameters.shape == (0,)
    assert table.check(table.defaults) is table.defaults
    with pytest.raises(UsageError, match=r"unknown parameter 'goal'; valid: \(none\)"):
        table.adjusted([], ["goal=1"])
