"""Feed-forward networks in float32: what the native engine's kernel computes, in numpy."""

from typing import Literal, NamedTuple

import numpy as np

Activation = Literal["linear", "elu", "silu", "tanh"]

NORM_EPSILON = np.float32(1e-5)  # added to the variance; the native kernel has the same


class Layer(NamedTuple):
    """One layer: y = gain * activation(norm(W x + b)).

    Attributes:
        weight: W, (outputs, inputs) float32.
        bias: b, (outputs,) float32.
        activation: of every output.
        norm: scale and shift of a layer normalisation, each (outputs,) float32, if there is one.
        gain: (outputs,) float32; None stands for ones.
    """

    weight: np.ndarray
    bias: np.ndarray
    activation: Activation = "linear"
    norm: tuple[np.ndarray, np.ndarray] | None = None
    gain: np.ndarray | None = None


def evaluate(layers: tuple[Layer, ...], rows: np.ndarray) -> np.ndarray:
    """Evaluate a network.

    Args:
        layers: first to last.
        rows: (..., inputs) float32.

    Returns:
        (..., outputs) float32.
    """
    # A stack of single rows, (..., 1, inputs): BLAS rounds the rows of one matrix differently by
    # their number and place, and a row's result must not depend on its neighbours.
    values = rows[..., None, :]
    for layer in layers:
        values = values @ layer.weight.T + layer.bias
        if layer.norm is not None:
            values = _normalised(values, *layer.norm)
        values = _activated(values, layer.activation)
        if layer.gain is not None:
            values = values * layer.gain
    return values[..., 0, :]


def _normalised(values: np.ndarray, scale: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Give every row zero mean and unit variance, then scale and shift."""
    centred = values - values.mean(axis=-1, keepdims=True)
    variance = (centred * centred).mean(axis=-1, keepdims=True)
    return centred / np.sqrt(variance + NORM_EPSILON) * scale + shift


def _activated(values: np.ndarray, activation: Activation) -> np.ndarray:
    if activation == "elu":
        return np.where(values > 0.0, values, np.expm1(np.minimum(values, 0.0)))
    if activation == "silu":
        return values / (1.0 + np.exp(np.minimum(-values, np.float32(87.0))))
    return np.tanh(values) if activation == "tanh" else values
