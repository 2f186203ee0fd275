import numpy as np

from sumo_dist.optim.optimizer import Belief
from sumo_dist.optim.ps import PredictiveSampling

BELIEF = Belief(np.zeros((2, 1)), np.ones((2, 1)))
KNOTS = np.arange(6, dtype=np.float32).reshape(3, 2, 1) / 10


def update(costs):
    return PredictiveSampling().update(BELIEF, KNOTS, np.array(costs))


def test_the_best_candidate_becomes_the_mean_and_sigma_stays():
    belief = update([3.0, np.inf, 1.0])
    assert np.array_equal(belief.mean, KNOTS[2])
    assert belief.sigma is BELIEF.sigma


def test_of_equal_costs_the_first_wins():
    assert np.array_equal(update([2.0, 1.0, 1.0]).mean, KNOTS[1])
