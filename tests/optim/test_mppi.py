import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.optim.mppi import PathIntegral, lower_deviation
from sumo_dist.optim.optimizer import Belief

BELIEF = Belief(np.zeros((1, 2)), np.ones((1, 2)))
KNOTS = np.array([[0.0, 0.8], [0.5, -0.2], [1.0, 0.0]], np.float32).reshape(3, 1, 2)


def mean(costs, temperature=0.1):
    return PathIntegral(temperature).update(BELIEF, KNOTS, np.array(costs, float)).mean


def test_weights_are_exponential_in_the_cost_over_temperature_and_spread():
    costs = np.array([3.0, 1.0, 2.0])
    scale = 0.5 * np.sqrt(0.5)  # of 1 and 2, whose median with 3 is 2
    w = np.exp(-(costs - 1.0) / scale)
    expected = (w[:, None, None] * KNOTS).sum(axis=0) / w.sum()
    assert mean(costs, temperature=0.5) == pytest.approx(expected, rel=1e-6)


def test_lost_candidates_have_no_weight():
    two = PathIntegral(0.1).update(BELIEF, KNOTS[[0, 2]], np.array([3.0, 1.0])).mean
    assert np.array_equal(mean([3.0, np.inf, 1.0]), two)


def test_equal_costs_give_the_plain_mean():
    assert mean([7.0, 7.0, 7.0]) == pytest.approx(KNOTS.mean(axis=0))


def test_a_low_temperature_takes_the_best_candidate():
    assert mean([3.0, 1.0, 2.0], temperature=1e-3) == pytest.approx(KNOTS[1])


def test_sigma_stays():
    assert PathIntegral().update(BELIEF, KNOTS, np.arange(3.0)).sigma is BELIEF.sigma


@given(
    costs=st.lists(st.integers(-1000, 1000), min_size=3, max_size=3),
    scale=st.floats(1e-3, 1e3),
    shift=st.floats(-1e3, 1e3),
)
def test_the_costs_scale_and_offset_do_not_matter(costs, scale, shift):
    costs = np.array(costs, float)
    assert mean(scale * costs + shift) == pytest.approx(mean(costs), abs=1e-5)


def test_the_spread_of_costs_about_their_median_is_their_standard_deviation():
    costs = np.random.default_rng(0).normal(3.0, 2.0, 100_001)
    assert lower_deviation(costs) == pytest.approx(2.0, rel=0.01)


RANKS = np.arange(32, dtype=np.float32).reshape(32, 1, 1)  # a candidate's knot is its rank
ONE = Belief(np.zeros((1, 1)), np.ones((1, 1)))


@given(
    lost=st.lists(st.floats(111.0, 1e9) | st.just(np.inf), max_size=16),
    temperature=st.sampled_from([0.03, 0.1, 0.3]),
)
def test_costs_of_the_worse_half_do_not_level_those_of_the_better(lost, temperature):
    costs = np.linspace(100.0, 110.0, 32)
    usual = PathIntegral(temperature).update(ONE, RANKS, costs).mean[0, 0]
    costs[len(costs) - len(lost) :] = lost
    assert PathIntegral(temperature).update(ONE, RANKS, costs).mean[0, 0] <= usual * 1.01


def test_the_best_alone_count_where_half_are_equally_good():
    assert mean([1.0, 1.0, 9.0]) == pytest.approx(KNOTS[:2].mean(axis=0))
