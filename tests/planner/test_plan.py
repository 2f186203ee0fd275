import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.planner.plan import Plan
from sumo_dist.timing import TICK, anchor_tick, plan_due

KNOTS = np.array([[0.0], [0.9], [-0.9], [0.3]], np.float32)


def test_plans_are_anchored_every_2_and_3_ticks_in_turn():
    assert [anchor_tick(number) for number in range(9)] == [0, 2, 5, 7, 10, 12, 15, 17, 20]


def test_a_second_has_20_plans():
    assert sum(plan_due(tick) is not None for tick in range(round(1.0 / TICK))) == 20


@given(st.integers(0, 10**9))
def test_a_plan_is_due_on_its_anchor_and_nowhere_else(number):
    tick = anchor_tick(number)
    assert plan_due(tick) == number
    between = range(tick + 1, anchor_tick(number + 1))
    assert all(plan_due(later) is None for later in between)


def test_follows_its_spline_from_its_anchor_and_holds_its_ends():
    plan = Plan(number=4, tick=10, knots=KNOTS, horizon=1.5, spline="linear")
    values = plan.at(np.array([0, 10, 35, 60, 85, 500]))[:, 0]
    assert values == pytest.approx([0.0, 0.0, 0.9, -0.9, 0.3, 0.3])


def test_ticks_and_times_are_the_same_axis():
    plan = Plan(number=4, tick=10, knots=KNOTS, horizon=1.5, spline="cubic")
    ticks = np.arange(10, 90)
    assert np.array_equal(plan.at(ticks), plan.at_times((ticks - 10) * TICK))
