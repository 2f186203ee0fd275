"""Splines over K equally spaced knots: zero-order, linear and cubic.

Every spline is linear in its knots, s(t) = sum_k w_k(t) x_k. The sum is written out over k so that
a rollout's commands have the same bits in whatever batch they are evaluated.
"""

from typing import Literal, get_args

import numpy as np

from sumo_dist.errors import unknown

Order = Literal["zero", "linear", "cubic"]


def weights(order: Order, nodes: int, horizon: float, times: np.ndarray) -> np.ndarray:
    """Weights w of the knots at some times.

    Args:
        order: "zero", "linear" or "cubic" (Hermite with finite-difference slopes).
        nodes: number of knots K, at times linspace(0, horizon, K).
        horizon: [s].
        times: (T,) [s] since the first knot; the end knots hold outside the horizon.

    Returns:
        (T, K) weights; each row sums to one.
    """
    if order not in get_args(Order):
        raise unknown("spline", order, get_args(Order))
    position = np.clip(np.asarray(times, float) / horizon, 0.0, 1.0) * (nodes - 1)
    nearest = np.rint(position)  # a time on a knot is on it, however it was rounded
    position = np.where(np.abs(position - nearest) < 1e-9, nearest, position)
    left = np.minimum(position.astype(int), max(nodes - 2, 0))
    right = np.minimum(left + 1, nodes - 1)
    u = (position - left)[:, None]
    knot = np.eye(nodes)
    if order == "zero":
        return np.where(u >= 1.0, knot[right], knot[left])
    if order == "linear":
        return (1.0 - u) * knot[left] + u * knot[right]
    slope = _finite_difference_slopes(knot)
    return (
        (2 * u**3 - 3 * u**2 + 1) * knot[left]
        + (u**3 - 2 * u**2 + u) * slope[left]
        + (3 * u**2 - 2 * u**3) * knot[right]
        + (u**3 - u**2) * slope[right]
    )


def evaluate(weights_: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Spline values (..., T, n) from weights (T, K) and knots (..., K, n)."""
    values = np.zeros((*knots.shape[:-2], len(weights_), knots.shape[-1]))
    for k in range(knots.shape[-2]):
        values += weights_[:, k, None] * knots[..., k : k + 1, :]
    return values


def _finite_difference_slopes(knot: np.ndarray) -> np.ndarray:
    """Slopes per node spacing: central differences inside, one-sided at the ends."""
    if len(knot) < 2:
        return np.zeros_like(knot)
    padded = np.concatenate([knot[:1], knot, knot[-1:]])
    slopes = (padded[2:] - padded[:-2]) * 0.5
    slopes[[0, -1]] *= 2.0
    return slopes
