import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.planner.plan import Plan
from sumo_dist.timing import TICK, TICK_RATE, anchor_tick, plan_due

KNOTS = np.array([[0.0], [0.9], [-0.9], [0.3]], np.float32)


@pytest.mark.parametrize(
    ("rate", "anchors"),
    [
        (20, [0, 2, 5, 7, 10, 12, 15, 17, 20]),
        (50, [0, 1, 2, 3, 4, 5, 6, 7, 8]),
        (7, [0, 7, 14, 21, 28, 35, 42, 50, 57]),
    ],
)
def test_plans_are_anchored_on_whole_ticks_as_evenly_as_they_allow(rate, anchors):
    assert [anchor_tick(number, rate) for number in range(9)] == anchors


def test_a_second_has_20_plans_unless_another_rate_is_asked_for():
    ticks = range(TICK_RATE)
    assert sum(plan_due(tick) is not None for tick in ticks) == 20
    for rate in range(1, TICK_RATE + 1):
        assert sum(plan_due(tick, rate) is not None for tick in ticks) == rate


@given(st.integers(0, 10**9), st.integers(1, TICK_RATE))
def test_a_plan_is_due_on_its_anchor_and_nowhere_else(number, rate):
    tick = anchor_tick(number, rate)
    assert plan_due(tick, rate) == number
    between = range(tick + 1, anchor_tick(number + 1, rate))
    assert all(plan_due(later, rate) is None for later in between)


def test_follows_its_spline_from_its_anchor_and_holds_its_ends():
    plan = Plan(number=4, tick=10, knots=KNOTS, horizon=1.5, spline="linear")
    values = plan.at(np.array([0, 10, 35, 60, 85, 500]))[:, 0]
    assert values == pytest.approx([0.0, 0.0, 0.9, -0.9, 0.3, 0.3])


def test_ticks_and_times_are_the_same_axis():
    plan = Plan(number=4, tick=10, knots=KNOTS, horizon=1.5, spline="cubic")
    ticks = np.arange(10, 90)
    assert np.array_equal(plan.at(ticks), plan.at_times((ticks - 10) * TICK))
