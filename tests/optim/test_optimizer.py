import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.errors import UsageError
from sumo_dist.optim import OPTIMIZERS, Belief, coloring, make_optimizer, noise_ramp
from sumo_dist.optim import sample as sample_coloured

RAMP = noise_ramp(0.02, 0.6, 4, 9)
BELIEF = Belief(np.linspace(-1.2, 0.9, 36).reshape(4, 9), RAMP)


def sample(belief, rollouts, rng, exponent=0.0):
    colors = coloring(exponent, len(belief.mean))
    return sample_coloured(belief, rollouts, rng, colors, np.ones(rollouts))


def generator(seed):
    return np.random.default_rng(seed)


def test_noise_variance_rises_linearly_from_0_02_to_0_6():
    """As printed in the paper for its four nodes."""
    variances = [0.02, 0.02 + 0.58 / 3, 0.02 + 2 * 0.58 / 3, 0.6]
    variance = noise_ramp(0.02, 0.6, 4, 9) ** 2  # (nodes, dimensions)
    assert variance == pytest.approx(np.repeat(np.array(variances)[:, None], 9, axis=1))


def test_noise_of_a_single_node_has_the_first_variance():
    assert noise_ramp(0.02, 0.6, 1, 3) ** 2 == pytest.approx(np.full((1, 3), 0.02))


def test_row_0_is_the_unperturbed_mean_within_limits():
    knots = sample(BELIEF, 32, generator(0))
    assert knots.shape == (32, 4, 9)
    assert knots.dtype == np.float32
    assert np.array_equal(knots[0], BELIEF.mean.clip(-1, 1).astype(np.float32))


@given(st.integers(1, 64), st.integers(0, 2**32 - 1))
def test_samples_stay_within_the_normalised_limits(rollouts, seed):
    knots = sample(Belief(BELIEF.mean, 10 * RAMP), rollouts, generator(seed))
    assert np.abs(knots).max() <= 1.0


def test_sampled_noise_has_the_ramps_spread():
    mean = np.zeros((4, 9))
    knots = sample(Belief(mean, RAMP * 0.1), 20_000, generator(1))  # small: nothing is clipped
    assert knots[1:].std(axis=0) == pytest.approx(RAMP * 0.1, rel=0.03)
    assert knots[1:].mean(axis=0) == pytest.approx(mean, abs=0.002)


def test_samples_are_decided_by_the_generator():
    assert np.array_equal(sample(BELIEF, 8, generator(3)), sample(BELIEF, 8, generator(3)))
    assert not np.array_equal(sample(BELIEF, 8, generator(3)), sample(BELIEF, 8, generator(4)))


@pytest.mark.parametrize("nodes", [1, 2, 3, 4, 7, 30])
def test_noise_of_exponent_0_is_exactly_white(nodes):
    assert np.array_equal(coloring(0.0, nodes), np.eye(nodes))


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("nodes", [1, 2, 4, 30, 100])
def test_coloured_noise_has_unit_variance_and_fades_with_distance(exponent, nodes):
    covariance = coloring(exponent, nodes) @ coloring(exponent, nodes).T
    assert np.diag(covariance) == pytest.approx(np.ones(nodes))
    assert (np.diff(covariance[0]) <= 1e-9).all()  # the last node is not tied to the first


def test_a_higher_exponent_ties_neighbours_more():
    ties = [coloring(exponent, 4)[1, 0] for exponent in (0.0, 0.5, 1.0, 2.0, 3.0)]
    assert ties == sorted(ties)
    assert ties == pytest.approx([0.0, 0.25, 0.48, 0.78, 0.90], abs=0.01)


def test_coloured_samples_have_the_ramps_spread_and_the_ties():
    belief = Belief(np.zeros((4, 9)), RAMP * 0.1)
    noise = sample(belief, 20_000, generator(1), exponent=2.0)[1:] / (RAMP * 0.1)
    assert noise.std(axis=0) == pytest.approx(np.ones((4, 9)), rel=0.03)
    assert np.mean(noise[:, 0] * noise[:, 1]) == pytest.approx(0.78, abs=0.02)
    assert np.mean(noise[:, 0, 0] * noise[:, 0, 1]) == pytest.approx(0.0, abs=0.02)


def test_the_number_of_candidates_does_not_change_them():
    assert np.array_equal(sample(BELIEF, 8, generator(3)), sample(BELIEF, 20, generator(3))[:8])


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_every_optimizer_keeps_its_belief_when_all_candidates_failed(name):
    optimizer = make_optimizer(name, elites=3, temperature=0.1)
    knots = sample(BELIEF, 8, generator(0))
    assert optimizer.update(BELIEF, knots, np.full(8, np.inf)) is BELIEF


@pytest.mark.parametrize("name", OPTIMIZERS)
@given(costs=st.lists(st.floats(0, 1e6) | st.just(np.inf), min_size=8, max_size=8))
def test_every_optimizer_stays_among_its_mean_and_finite_candidates(name, costs):
    optimizer = make_optimizer(name, elites=3, temperature=0.1)
    knots, costs = sample(BELIEF, 8, generator(0)), np.array(costs)
    belief = optimizer.update(BELIEF, knots, costs)
    assert np.isfinite(belief.mean).all()
    assert np.isfinite(belief.sigma).all()
    if np.isfinite(costs).any():
        alive = np.concatenate([BELIEF.mean[None], knots[np.isfinite(costs)]])
        assert (belief.mean >= alive.min(axis=0) - 1e-6).all()
        assert (belief.mean <= alive.max(axis=0) + 1e-6).all()


def bowl(knots):
    return ((knots - 0.4) ** 2).sum(axis=(-1, -2))


def valley(knots):
    """Rosenbrock's function with its minimum at (0.8, 0.64)."""
    x, y = knots[..., 0, 0].astype(float), knots[..., 1, 0].astype(float)
    return (0.8 - x) ** 2 + 20 * (y - x**2) ** 2


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_every_optimizer_finds_the_minimum_of_a_bowl(name):
    optimizer = make_optimizer(name, elites=3, temperature=0.1)
    mean, sigma, rng = np.zeros((2, 3)), np.full((2, 3), 0.1), generator(0)
    for _ in range(60):
        knots = sample(Belief(mean, sigma), 32, rng)
        mean = optimizer.update(Belief(mean, sigma), knots, bowl(knots)).mean
    assert bowl(mean) < 0.05 * bowl(np.zeros((2, 3)))


@pytest.mark.parametrize(
    ("name", "of_bowl", "of_valley"),
    # CEM and iCEM refit their spread to few elites and stop early; MPPI and PS do not narrow.
    [
        ("cem", 0.03, 0.3),
        ("icem", 0.1, 0.3),
        ("mppi", 0.02, 0.2),
        ("ps", 0.1, 0.02),
        ("cma", 1e-9, 1e-2),
    ],
)
def test_inner_iterations_go_on_to_the_minimum(name, of_bowl, of_valley):
    def share_left(cost, shape):
        optimizer, rng = make_optimizer(name, elites=8, temperature=0.1), generator(0)
        belief = Belief(np.zeros(shape), np.full(shape, 0.3))
        for _ in range(60):
            knots = sample(belief, 32, rng)
            belief = optimizer.update(belief, knots, cost(knots))
        return cost(belief.mean) / cost(np.zeros(shape))

    assert share_left(bowl, (2, 3)) < of_bowl
    assert share_left(valley, (2, 1)) < of_valley


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_the_costs_scale_and_offset_and_the_order_of_candidates_do_not_matter(name):
    def second_mean(scale, offset, order):
        optimizer, belief = make_optimizer(name, elites=3, temperature=0.1), BELIEF
        for seed in range(2):
            knots = sample(belief, 12, generator(seed))[order]
            belief = optimizer.update(belief, knots, scale * bowl(knots) + offset)
        return belief.mean

    given_ = second_mean(1.0, 0.0, np.arange(12))
    assert second_mean(1e3, -50.0, np.arange(12)) == pytest.approx(given_, abs=1e-4)
    assert second_mean(1.0, 0.0, np.arange(12)[::-1]) == pytest.approx(given_, abs=1e-6)


def test_unknown_optimizer_names_the_valid_ones():
    with pytest.raises(
        UsageError, match="unknown optimizer 'sgd'; valid: cem, cma, icem, mppi, ps"
    ):
        make_optimizer("sgd", elites=3, temperature=0.1)
