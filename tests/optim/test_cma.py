import numpy as np
import pytest

from sumo_dist.optim import Belief, make_optimizer
from sumo_dist.optim import sample as sample_shared
from sumo_dist.optim.cma import CovarianceAdaptation, Evolution, Rates

START = Belief(np.zeros((3, 2)), np.full((3, 2), 0.3))


def sample(belief, candidates, rng):
    white = np.eye(len(belief.mean))
    return sample_shared(belief, candidates, rng, white, np.ones(candidates))


def evolve(cost, generations, belief=START, candidates=32, seed=0):
    optimizer, rng = make_optimizer("cma", elites=3, temperature=0.1), np.random.default_rng(seed)
    for _ in range(generations):
        knots = sample(belief, candidates, rng)
        belief = optimizer.update(belief, knots, cost(knots))
    return belief


def test_constants_are_the_standards():
    """Those of pip's cmaes 0.13 for 16 candidates in 36 dimensions, times 38 / 3 for a diagonal."""
    rates = Rates.of(candidates=16, n=36)
    assert len(rates.weights) == 8
    assert rates.weights.sum() == pytest.approx(1.0)
    assert rates.weights[0] / rates.weights[7] == pytest.approx(np.log(8.5) / np.log(8.5 / 8))
    assert rates.mu_eff == pytest.approx(4.840914500901175)
    assert rates.path_white == pytest.approx(0.14923163238304704)
    assert rates.path == pytest.approx(0.10267143556830505)
    assert rates.damping == pytest.approx(1.1492316323830472)
    assert rates.rank_one == pytest.approx(0.0014325304161859167 * 38 / 3)
    assert rates.rank_mu == pytest.approx(0.004206793181358261 * 38 / 3)


def test_rates_are_sound_for_any_population():
    for candidates in range(1, 200):
        for n in (1, 2, 9, 36, 900):
            rates = Rates.of(candidates, n)
            assert (rates.weights > 0).all()
            assert rates.weights.sum() == pytest.approx(1.0)
            assert 0 <= rates.rank_one + rates.rank_mu <= 1
            assert 0 < rates.path_white < 1 and 0 < rates.path <= 1 <= rates.damping


def test_the_mean_moves_to_the_better_half_by_weight():
    knots = np.array([0.1, 0.2, 0.4, 0.6, 0.9], np.float32).reshape(5, 1, 1)
    belief = Belief(np.zeros((1, 1)), np.ones((1, 1)))
    mean = CovarianceAdaptation().update(belief, knots, np.array([9.0, 1.0, 2.0, 3.0, 8.0])).mean
    weights = np.log(3.0) - np.log([1.0, 2.0])  # of two of five
    assert mean.item() == pytest.approx((weights @ [0.2, 0.4]) / weights.sum())


def test_lost_candidates_were_never_drawn():
    rng = np.random.default_rng(0)
    knots, costs = sample(START, 12, rng), rng.standard_normal(12)
    lost = costs.copy()
    lost[[2, 5, 7]] = np.inf
    with_lost = CovarianceAdaptation().update(START, knots, lost)
    without = CovarianceAdaptation().update(START, knots[lost < np.inf], lost[lost < np.inf])
    assert np.array_equal(with_lost.mean, without.mean)
    assert np.array_equal(with_lost.sigma, without.sigma)


def test_a_generation_that_is_lost_changes_nothing():
    belief = evolve(lambda knots: (knots**2).sum(axis=(1, 2)), 3)
    knots = sample(belief, 8, np.random.default_rng(0))
    assert CovarianceAdaptation().update(belief, knots, np.full(8, np.inf)) is belief


def test_finds_the_minimum_of_a_bowl_to_many_digits():
    scale = np.logspace(0, 3, 6).reshape(3, 2)
    belief = evolve(lambda knots: (scale * (knots - 0.4) ** 2).sum(axis=(1, 2)), 100)
    assert belief.mean == pytest.approx(np.full((3, 2), 0.4), abs=1e-4)
    assert belief.sigma.max() < 0.01


def test_spreads_follow_the_curvature():
    """At the minimum of sum c x^2, the ideal spread is proportional to 1 / sqrt(c)."""
    scale = np.array([1.0, 1.0, 1.0, 100.0, 100.0, 100.0]).reshape(3, 2)
    belief = evolve(lambda knots: (scale * knots**2).sum(axis=(1, 2)), 60)
    flat, steep = belief.sigma.ravel()[:3].mean(), belief.sigma.ravel()[3:].mean()
    assert flat / steep == pytest.approx(10.0, rel=0.6)


def test_the_step_grows_on_a_slope_and_shrinks_in_a_bowl():
    small = Belief(np.zeros((3, 2)), np.full((3, 2), 0.01))
    slope = evolve(lambda knots: knots.sum(axis=(1, 2)), 10, small)
    bowl = evolve(lambda knots: (knots**2).sum(axis=(1, 2)), 10)
    assert isinstance(slope, Evolution) and isinstance(bowl, Evolution)
    assert slope.step > 2.0
    assert bowl.step < 0.7


def test_scaling_an_axis_scales_the_search():
    """Moves in units of the spread do not depend on the spread: no dimension is preferred."""
    scale = np.array([1.0, 0.1, 0.5, 0.2, 0.7, 0.3]).reshape(3, 2)
    square = Belief(START.mean, np.full((3, 2), 0.1))
    scaled = Belief(START.mean, 0.1 * scale)
    even = evolve(lambda knots: ((knots - 0.05) ** 2).sum(axis=(1, 2)), 10, square)
    uneven = evolve(lambda knots: ((knots / scale - 0.05) ** 2).sum(axis=(1, 2)), 10, scaled)
    assert uneven.mean == pytest.approx(scale * even.mean, abs=1e-5)
    assert uneven.sigma == pytest.approx(scale * even.sigma, rel=1e-3)


def test_a_minimum_beyond_the_limits_is_approached_at_them():
    belief = evolve(lambda knots: ((knots - 3.0) ** 2).sum(axis=(1, 2)), 40)
    assert belief.mean == pytest.approx(np.ones((3, 2)), abs=0.02)
