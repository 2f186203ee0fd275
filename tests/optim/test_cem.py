import numpy as np
import pytest

from sumo_dist.optim.cem import CrossEntropy
from sumo_dist.optim.optimizer import Belief

BELIEF = Belief(np.zeros((1, 1)), np.ones((1, 1)))
KNOTS = np.array([0.1, 0.2, 0.4, 0.6, 0.9], np.float32).reshape(5, 1, 1)


def update(elites, costs):
    belief = CrossEntropy(elites).update(BELIEF, KNOTS, np.array(costs, float))
    return belief.mean.item(), belief.sigma.item()


def test_mean_and_spread_are_those_of_the_best_three():
    mean, sigma = update(3, [9.0, 1.0, 2.0, 3.0, 8.0])  # the elites are 0.2, 0.4, 0.6
    assert mean == pytest.approx(0.4)
    assert sigma == pytest.approx(np.sqrt((0.2**2 + 0.0 + 0.2**2) / 3))


def test_lost_candidates_are_no_elites():
    mean, sigma = update(3, [np.inf, 1.0, np.inf, 3.0, np.inf])  # only 0.2 and 0.6 came back
    assert mean == pytest.approx(0.4)
    assert sigma == pytest.approx(0.2)


def test_of_equal_costs_the_first_candidates_count():
    assert update(2, [1.0] * 5)[0] == pytest.approx(0.15)


def test_more_elites_than_candidates_are_all_candidates():
    assert update(99, [1.0] * 5)[0] == pytest.approx(0.44)
