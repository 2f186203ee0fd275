"""The float32 network kernels of the native engine."""

from itertools import pairwise

import numpy as np
import pytest

native = pytest.importorskip("sumo_dist.rollout._native", reason="not compiled here")
pytestmark = pytest.mark.parametrize("portable", [False, True])

SIZES = [(84, 512, 256, 128, 12), (1, 1), (3, 17, 5), (100, 33, 64, 29)]


def network(sizes, seed=0):
    rng = np.random.default_rng(seed)
    return [
        (
            rng.normal(scale=inputs**-0.5, size=(outputs, inputs)).astype(np.float32),
            rng.normal(scale=0.1, size=outputs).astype(np.float32),
        )
        for inputs, outputs in pairwise(sizes)
    ]


def evaluate(layers, rows, portable):
    outputs = np.full((len(rows), len(layers[-1][1])), np.nan, np.float32)
    native.evaluate(layers, rows, outputs, portable)
    return outputs


def exact(layers, rows):
    values = rows.astype(np.float64)
    for index, (weight, bias) in enumerate(layers):
        values = values @ weight.T.astype(np.float64) + bias
        if index + 1 < len(layers):
            values = np.where(values > 0.0, values, np.expm1(np.minimum(values, 0.0)))
    return values


@pytest.mark.parametrize("sizes", SIZES)
def test_agrees_with_double_precision(sizes, portable):
    rows = np.random.default_rng(1).normal(size=(19, sizes[0])).astype(np.float32)
    layers = network(sizes)
    np.testing.assert_allclose(evaluate(layers, rows, portable), exact(layers, rows), atol=3e-6)


@pytest.mark.parametrize("sizes", SIZES)
def test_rows_do_not_depend_on_the_batch(sizes, portable):
    rows = np.random.default_rng(2).normal(size=(35, sizes[0])).astype(np.float32)
    layers = network(sizes)
    expected = evaluate(layers, rows, portable)
    for size in range(1, len(rows)):
        for part in (slice(0, size), slice(len(rows) - size, len(rows))):
            batch = np.ascontiguousarray(rows[part])
            np.testing.assert_array_equal(evaluate(layers, batch, portable), expected[part])


def test_elu_is_accurate_everywhere(portable):
    """1.2e-7 absolute, and 2 ulp where x is small: one ELU between two identities."""
    identity = (np.ones((1, 1), np.float32), np.zeros(1, np.float32))
    x = np.concatenate(
        (
            -np.geomspace(1e-30, 1e4, 200_001),
            np.linspace(-20.0, 20.0, 100_001),
            [0.0, -np.inf, np.inf, np.nan],
        )
    ).astype(np.float32)[:, None]
    found = evaluate([identity, identity], x, portable)
    expected = np.where(x > 0, x, np.expm1(np.minimum(x.astype(np.float64), 0.0)))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1.2e-7)
    small = (np.abs(x) < 0.3) & (x < 0)
    np.testing.assert_allclose(found[small], expected[small], rtol=2.4e-7)


def test_refuses_layers_that_do_not_fit(portable):
    layers = network((3, 4, 5))
    rows, outputs = np.zeros((2, 3), np.float32), np.zeros((2, 5), np.float32)
    with pytest.raises(ValueError, match="layers do not fit together"):
        native.evaluate(layers[::-1], rows, outputs, portable)
    with pytest.raises(ValueError, match="without layers"):
        native.evaluate([], rows, outputs, portable)
    with pytest.raises(ValueError, match="do not fit the network"):
        native.evaluate(layers, rows[:, :2].copy(), outputs, portable)
