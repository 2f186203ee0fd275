from typing import get_args

import numpy as np
import pytest

from sumo_dist.optim import Belief, Placement, noise_shares, sample
from sumo_dist.optim.placement import NEAR

BASE = np.array([True, True, True, False, False])
FULL, LIMBS = np.ones(5), np.where(BASE, 0.0, 1.0)


def test_alike_leaves_every_candidate_all_its_noise():
    assert np.array_equal(noise_shares("alike", 9, BASE), np.ones((9, 5)))


def test_every_second_candidate_is_near():
    expected = np.where(np.arange(9)[:, None] % 2, 1.0, NEAR) * np.ones(5)
    expected[0] = 1.0  # the mean itself has no noise
    assert np.array_equal(noise_shares("near", 9, BASE), expected)


def test_of_eight_candidates_two_move_the_base_alone_and_two_all_but_it():
    parts = [BASE, LIMBS, FULL, FULL]
    expected = [share * part for part in parts for share in (1.0, NEAR)]
    shares = noise_shares("mixed", 17, BASE)
    assert np.array_equal(shares[1:], np.tile(expected, (2, 1)))


@pytest.mark.parametrize("placement", get_args(Placement))
def test_a_candidate_depends_on_its_row_alone(placement):
    many = noise_shares(placement, 40, BASE)
    for rollouts in (1, 2, 3, 8, 17):
        assert np.array_equal(noise_shares(placement, rollouts, BASE), many[:rollouts])


@pytest.mark.parametrize("base", [np.ones(4, bool), np.zeros(4, bool)])
def test_actions_of_one_kind_are_never_left_without_noise(base):
    mixed = noise_shares("mixed", 17, base)
    assert np.array_equal(mixed, noise_shares("near", 17, base))


def test_candidates_lie_where_their_shares_put_them():
    belief = Belief(np.full((3, 5), 0.1), np.full((3, 5), 0.05))  # small: nothing is clipped
    rng = np.random.default_rng(0)
    knots = sample(belief, 8001, rng, np.eye(3), noise_shares("mixed", 8001, BASE))
    spread = (knots[1:] - knots[0]).reshape(1000, 8, 3, 5).std(axis=(0, 2)) / 0.05  # (8, n)
    assert spread == pytest.approx(noise_shares("mixed", 9, BASE)[1:], rel=0.06)
    assert np.array_equal(knots[0], belief.mean.astype(np.float32))
