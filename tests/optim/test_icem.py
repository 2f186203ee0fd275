import numpy as np
import pytest

from sumo_dist.optim.cem import CrossEntropy
from sumo_dist.optim.icem import MOMENTUM, EliteBelief, ImprovedCrossEntropy
from sumo_dist.optim.optimizer import Belief

BELIEF = Belief(np.full((1, 1), -0.5), np.ones((1, 1)))


def column(*values):
    return np.array(values, np.float32).reshape(-1, 1, 1)


def update(belief, knots, costs, elites=3):
    return ImprovedCrossEntropy(elites).update(belief, column(*knots), np.array(costs, float))


def test_the_first_update_is_that_of_cem_with_a_share_of_the_belief_before():
    knots, costs = (0.1, 0.2, 0.4, 0.6, 0.9), (9.0, 1.0, 2.0, 3.0, 8.0)
    cem = CrossEntropy(3).update(BELIEF, column(*knots), np.array(costs))
    icem = update(BELIEF, knots, costs)
    assert icem.mean == pytest.approx(MOMENTUM * -0.5 + (1 - MOMENTUM) * cem.mean)
    assert icem.sigma == pytest.approx(MOMENTUM * 1.0 + (1 - MOMENTUM) * cem.sigma)


def test_elites_compete_in_the_next_iteration():
    first = update(BELIEF, (0.1, 0.2, 0.4), (1.0, 3.0, 5.0))
    second = update(first, (0.6, 0.8), (2.0, 4.0))
    assert isinstance(second, EliteBelief)
    assert second.knots.ravel() == pytest.approx([0.1, 0.6, 0.2])
    assert second.costs.tolist() == [1.0, 2.0, 3.0]
    best = np.mean([0.1, 0.6, 0.2])
    assert second.mean.item() == pytest.approx(MOMENTUM * first.mean.item() + 0.9 * best)


def test_worse_candidates_do_not_displace_elites():
    first = update(BELIEF, (0.1, 0.2, 0.4), (1.0, 3.0, 5.0))
    second = update(first, (0.6, 0.8), (7.0, 8.0))
    assert isinstance(second, EliteBelief)
    assert second.costs.tolist() == [1.0, 3.0, 5.0]


def test_lost_candidates_are_no_elites():
    first = update(BELIEF, (0.1, 0.2, 0.4, 0.6), (np.inf, 3.0, np.inf, 5.0))
    assert isinstance(first, EliteBelief)
    assert first.costs.tolist() == [3.0, 5.0]


def test_an_iteration_that_is_lost_changes_nothing():
    first = update(BELIEF, (0.1, 0.2, 0.4), (1.0, 3.0, 5.0))
    assert update(first, (0.6, 0.8), (np.inf, np.inf)) is first


def test_nothing_is_carried_from_plan_to_plan():
    """Each plan starts from a plain belief: no elites of the last one compete."""
    update(BELIEF, (0.1, 0.2, 0.4), (-1e9, -1e9, -1e9))
    again = update(BELIEF, (0.6,), (1.0,))
    assert isinstance(again, EliteBelief)
    assert again.knots.ravel() == pytest.approx([0.6])
