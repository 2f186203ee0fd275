from typing import get_args

import numpy as np
import pytest

from sumo_dist.optim import Belief, Placement, noise_shares, sample
from sumo_dist.optim.placement import NEAR


def test_alike_leaves_every_candidate_all_its_noise():
    assert noise_shares("alike", 5).tolist() == [1.0] * 5


def test_every_second_candidate_is_near():
    assert noise_shares("near", 6).tolist() == [1.0, 1.0, NEAR, 1.0, NEAR, 1.0]


@pytest.mark.parametrize("placement", get_args(Placement))
def test_a_candidate_depends_on_its_row_alone(placement):
    many = noise_shares(placement, 40)
    for rollouts in (1, 2, 3, 8, 17):
        assert np.array_equal(noise_shares(placement, rollouts), many[:rollouts])


def test_candidates_lie_where_their_shares_put_them():
    belief = Belief(np.full((3, 5), 0.1), np.full((3, 5), 0.05))  # small: nothing is clipped
    rng = np.random.default_rng(0)
    knots = sample(belief, 8001, rng, np.eye(3), noise_shares("near", 8001))
    assert np.array_equal(knots[0], belief.mean.astype(np.float32))
    spread = (knots[1:] - knots[0]).reshape(4000, 2, 3, 5).std(axis=0) / 0.05  # (2, K, n)
    assert spread[0] == pytest.approx(np.ones((3, 5)), rel=0.06)
    assert spread[1] == pytest.approx(np.full((3, 5), NEAR), rel=0.06)
