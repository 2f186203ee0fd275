import numpy as np
import pytest
from hypothesis import given as for_all
from hypothesis import strategies as st

from sumo_dist.errors import UsageError
from sumo_dist.math.splines import evaluate, given, knot_times, weights
from sumo_dist.timing import TICK

ORDERS = ("zero", "linear", "cubic", "smooth")
orders = st.sampled_from(ORDERS)
nodes = st.integers(3, 12)
horizons = st.integers(1, 200).map(lambda ticks: ticks * TICK)
times = st.lists(st.floats(-5.0, 10.0), min_size=1, max_size=20).map(np.array)


@for_all(orders, nodes, horizons, times)
def test_weights_sum_to_one(order, count, horizon, when):
    assert weights(order, count, horizon, when).sum(axis=1) == pytest.approx(1.0, abs=1e-9)


@for_all(orders, nodes, horizons)
def test_passes_through_its_knots(order, count, horizon):
    knots = knot_times(order, count, horizon)
    assert weights(order, count, horizon, knots) == pytest.approx(np.eye(count), abs=1e-9)


@for_all(orders, nodes, horizons, st.floats(1e-6, 10.0))
def test_holds_the_end_knots_outside_the_horizon(order, count, horizon, away):
    knot = np.eye(count)
    first = knot_times(order, count, horizon)[0]
    before, after = weights(order, count, horizon, np.array([first - away, horizon + away]))
    assert before == pytest.approx(knot[0], abs=1e-9)
    assert after == pytest.approx(knot[-1], abs=1e-9)


def test_zero_order_holds_each_knot_until_the_next():
    knots = np.array([[1.0], [2.0], [4.0]])
    when = np.array([0.0, 0.49, 0.5, 0.99, 1.0])
    values = evaluate(weights("zero", 3, 1.0, when), knots)
    assert values[:, 0].tolist() == [1.0, 1.0, 2.0, 2.0, 4.0]


@for_all(st.integers(1, 12), st.integers(1, 40))
def test_zero_order_changes_on_the_tick_of_a_knot(count, ticks_between):
    """Whatever the rounding of tick * 0.02 s: the robot and the rollouts switch on that tick."""
    ticks = np.arange(count * ticks_between + 1)
    rows = weights("zero", count + 1, count * ticks_between * TICK, ticks * TICK)
    assert rows.argmax(axis=1).tolist() == (ticks // ticks_between).tolist()


def test_linear_is_halfway_between_two_knots():
    knots = np.array([[0.0, 10.0], [2.0, -10.0]])
    assert evaluate(weights("linear", 2, 1.0, np.array([0.5])), knots).tolist() == [[1.0, 0.0]]


@for_all(st.sampled_from(("linear", "cubic", "smooth")), nodes, horizons, st.floats(-9, 9))
def test_all_but_the_zero_order_reproduce_lines(order, count, horizon, slope):
    when = np.linspace(0.0, horizon, 50)
    line = slope * knot_times(order, count, horizon)[:, None] + 1.0
    values = evaluate(weights(order, count, horizon, when), line)
    assert values[:, 0] == pytest.approx(slope * when + 1.0, abs=1e-7)


def test_cubic_has_a_continuous_slope():
    knots = np.array([[0.0], [1.0], [-1.0], [0.5]])
    h = 1e-5
    for inner in (0.5, 1.0):
        at = evaluate(weights("cubic", 4, 1.5, np.array([inner - h, inner, inner + h])), knots)
        left, right = np.diff(at[:, 0]) / h
        assert left == pytest.approx(right, abs=1e-3)


@for_all(st.integers(3, 9), st.integers(5, 60), st.integers(0, 2**32 - 1))
def test_a_smooth_spline_goes_on_in_value_and_slope(count, tick, seed):
    """Wherever one spline is, another one that is given the knots of there goes on."""
    one, other = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, count, 2))
    h, now = 1e-6, tick * TICK

    def value(knots, when):
        return evaluate(weights("smooth", count, 1.5, np.array([when])), knots)[0]

    other[: given("smooth")] = [value(one, now - TICK), value(one, now)]
    assert value(other, 0.0) == pytest.approx(value(one, now), abs=1e-9)
    start = (value(other, h) - value(other, 0.0)) / h
    before = (value(one, now) - value(one, now - TICK)) / TICK
    assert start == pytest.approx(before, abs=1e-2)


@for_all(orders, st.integers(3, 5), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_a_row_has_the_same_bits_in_any_batch(order, count, rows, seed):
    knots = np.random.default_rng(seed).normal(size=(rows, count, 9)).astype(np.float32)
    matrix = weights(order, count, 1.5, np.arange(75) * TICK)
    whole = evaluate(matrix, knots)
    assert all(
        np.array_equal(evaluate(matrix, row), got) for row, got in zip(knots, whole, strict=True)
    )


def test_unknown_order_names_the_valid_ones():
    with pytest.raises(
        UsageError, match="unknown spline 'quintic'; valid: cubic, linear, smooth, zero"
    ):
        weights("quintic", 4, 1.5, np.zeros(1))
