"""The float32 network kernels of the native engine."""

from itertools import pairwise

import numpy as np
import pytest

from sumo_dist.policies.network import Layer
from sumo_dist.policies.network import evaluate as evaluate_in_numpy

native = pytest.importorskip("sumo_dist.rollout._native", reason="not compiled here")
KERNELS = native.kernels()
pytestmark = pytest.mark.parametrize("kernel", [name for name, _ in KERNELS])

SIZES = [(84, 512, 256, 128, 12), (1, 1), (3, 17, 5), (100, 33, 64, 29)]


STYLES = ("elu", "silu, normalised", "tanh, amplified")


def network(sizes, style="elu", seed=0):
    rng = np.random.default_rng(seed)
    activation, _, extra = style.partition(", ")

    def numbers(size, centre=0.0):
        return rng.normal(centre, 0.1, size).astype(np.float32)

    layers = []
    for inputs, outputs in pairwise(sizes):
        weight = rng.normal(scale=inputs**-0.5, size=(outputs, inputs)).astype(np.float32)
        norm = (numbers(outputs, 1.0), numbers(outputs)) if extra == "normalised" else None
        gain = numbers(outputs, 1.0) if extra == "amplified" else None
        layers.append(Layer(weight, numbers(outputs), activation, norm, gain))
    return [*layers[:-1], layers[-1]._replace(activation="linear")]


def evaluate(layers, rows, kernel):
    outputs = np.full((len(rows), len(layers[-1].bias)), np.nan, np.float32)
    native.evaluate(layers, rows, outputs, kernel)
    return outputs


ACTIVATIONS = {
    "linear": lambda x: x,
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    "silu": lambda x: x / (1.0 + np.exp(np.minimum(-x, 700.0))),
    "tanh": np.tanh,
}


def exact(layers, rows):
    values = rows.astype(np.float64)
    for weight, bias, activation, norm, gain in layers:
        values = values @ weight.T.astype(np.float64) + bias
        if norm is not None:
            values = values - values.mean(axis=1, keepdims=True)
            values = values / np.sqrt((values**2).mean(axis=1, keepdims=True) + 1e-5)
            values = values * norm[0] + norm[1]
        values = ACTIVATIONS[activation](values)
        values = values if gain is None else values * gain
    return values


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("sizes", SIZES)
def test_agrees_with_double_precision(sizes, style, kernel):
    rows = np.random.default_rng(1).normal(size=(19, sizes[0])).astype(np.float32)
    layers = network(sizes, style)
    expected = exact(layers, rows)
    np.testing.assert_allclose(evaluate(layers, rows, kernel), expected, atol=3e-6)
    np.testing.assert_allclose(evaluate_in_numpy(tuple(layers), rows), expected, atol=3e-6)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("sizes", SIZES)
def test_rows_do_not_depend_on_the_batch(sizes, style, kernel):
    rows = np.random.default_rng(2).normal(size=(35, sizes[0])).astype(np.float32)
    layers = network(sizes, style)
    expected = evaluate(layers, rows, kernel)
    for size in range(1, len(rows)):
        for part in (slice(0, size), slice(len(rows) - size, len(rows))):
            batch = np.ascontiguousarray(rows[part])
            np.testing.assert_array_equal(evaluate(layers, batch, kernel), expected[part])


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("sizes", [*SIZES, (100, 512, 256, 29), (5, 200)])
def test_kernels_of_equal_bits_have_equal_bits(sizes, style, kernel):
    """What a host plans does not depend on how wide its vectors are."""
    layers, bits = network(sizes, style), dict(KERNELS)[kernel]
    first = next(name for name, its in KERNELS if its == bits)
    for rows in range(1, 20):
        inputs = np.random.default_rng(rows).normal(size=(rows, sizes[0])).astype(np.float32)
        found, expected = (evaluate(layers, inputs, each) for each in (kernel, first))
        np.testing.assert_array_equal(found.view(np.int32), expected.view(np.int32))


def test_activations_of_equal_bits_have_equal_bits_everywhere(kernel):
    first = next(name for name, its in KERNELS if its == dict(KERNELS)[kernel])
    x = np.concatenate((everywhere(), [[-np.inf], [np.inf]])).astype(np.float32)
    for activation in ACTIVATIONS:
        found, expected = (evaluate([alone(activation)], x, each) for each in (kernel, first))
        np.testing.assert_array_equal(found, expected)  # NaN where NaN is


def test_elu_is_accurate_everywhere(kernel):
    """1.2e-7 absolute, and 2 ulp where x is small."""
    x = np.concatenate((everywhere(), [[-np.inf], [np.inf]])).astype(np.float32)
    found = evaluate([alone("elu")], x, kernel)
    expected = np.where(x > 0, x, np.expm1(np.minimum(x.astype(np.float64), 0.0)))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1.2e-7)
    small = (np.abs(x) < 0.3) & (x < 0)
    np.testing.assert_allclose(found[small], expected[small], rtol=2.4e-7)


@pytest.mark.parametrize("activation", ["silu", "tanh"])
def test_silu_and_tanh_are_accurate_everywhere(activation, kernel):
    """4 ulp of the result wherever that is a normal number, and NaN where x is."""
    x = everywhere()
    found = evaluate([alone(activation)], x, kernel)
    expected = ACTIVATIONS[activation](x.astype(np.float64))
    np.testing.assert_allclose(found, expected, rtol=4.8e-7, atol=1e-30)


def alone(activation):
    """One input, one output, nothing but an activation."""
    return Layer(np.ones((1, 1), np.float32), np.zeros(1, np.float32), activation)


def everywhere():
    """Numbers of all sizes, (n, 1) float32."""
    sizes = np.geomspace(1e-25, 1e4, 200_001)
    parts = (-sizes, sizes, np.linspace(-20.0, 20.0, 100_001), [0.0, np.nan])
    return np.concatenate(parts).astype(np.float32)[:, None]


def test_refuses_layers_that_do_not_fit(kernel):
    layers = network((3, 4, 5))
    rows, outputs = np.zeros((2, 3), np.float32), np.zeros((2, 5), np.float32)
    with pytest.raises(ValueError, match="layers do not fit together"):
        native.evaluate(layers[::-1], rows, outputs, kernel)
    with pytest.raises(ValueError, match="without layers"):
        native.evaluate([], rows, outputs, kernel)
    with pytest.raises(ValueError, match="unknown activation; valid: linear, elu"):
        native.evaluate([layers[0]._replace(activation="relu")], rows, outputs, kernel)
    short = layers[0]._replace(gain=np.ones(3, np.float32))
    with pytest.raises(ValueError, match="norm and gain do not fit"):
        native.evaluate([short], rows, outputs, kernel)
    with pytest.raises(ValueError, match="do not fit the network"):
        native.evaluate(layers, rows[:, :2].copy(), outputs, kernel)
    with pytest.raises(ValueError, match="no kernel of this name"):
        native.evaluate(layers, rows, outputs, f"{kernel}0")
