"""Splines over K knots: zero-order, linear, cubic, and a cubic that goes on from a motion.

The knots are equally spaced over the horizon. The order "smooth" has one more, a tick before the
start: with the knot at the start it is the slope that the spline begins with, so that one spline
can go on where another one is, in value and slope.

Every spline is linear in its knots, s(t) = sum_k w_k(t) x_k. The sum is written out over k so that
a rollout's commands have the same bits in whatever batch they are evaluated.
"""

from typing import Literal, get_args

import numpy as np

from sumo_dist.errors import unknown
from sumo_dist.timing import TICK

Order = Literal["zero", "linear", "cubic", "smooth"]


def knot_times(order: Order, nodes: int, horizon: float) -> np.ndarray:
    """Times (K,) of the knots since the start [s]."""
    if order == "smooth":
        return np.concatenate([[-TICK], np.linspace(0.0, horizon, nodes - 1)])
    return np.linspace(0.0, horizon, nodes)


def given(order: Order) -> int:
    """Return how many knots, the first ones, say where a spline goes on from."""
    return 2 if order == "smooth" else 0


def weights(order: Order, nodes: int, horizon: float, times: np.ndarray) -> np.ndarray:
    """Weights w of the knots at some times.

    Args:
        order: "zero", "linear", "cubic" (Hermite with finite-difference slopes) or "smooth" (the
            same, its first slope that from the knot a tick before).
        nodes: number of knots K, at `knot_times`; "smooth" needs 3.
        horizon: [s].
        times: (T,) [s] since the start; beyond the knots, the end knots hold.

    Returns:
        (T, K) weights; each row sums to one.
    """
    if order not in get_args(Order):
        raise unknown("spline", order, get_args(Order))
    if order == "smooth":
        return _smooth(nodes, horizon, np.asarray(times, float))
    left, right, u = _places(nodes, horizon, times)
    knot = np.eye(nodes)
    if order == "zero":
        return np.where(u >= 1.0, knot[right], knot[left])
    if order == "linear":
        return (1.0 - u) * knot[left] + u * knot[right]
    return _hermite(knot, _finite_difference_slopes(knot), left, right, u)


def evaluate(weights_: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Spline values (..., T, n) from weights (T, K) and knots (..., K, n)."""
    values = np.zeros((*knots.shape[:-2], len(weights_), knots.shape[-1]))
    for k in range(knots.shape[-2]):
        values += weights_[:, k, None] * knots[..., k : k + 1, :]
    return values


def _smooth(nodes: int, horizon: float, times: np.ndarray) -> np.ndarray:
    knot = np.eye(nodes)
    before, ahead = knot[0], knot[1:]
    slope = _finite_difference_slopes(ahead)
    slope[0] = (ahead[0] - before) * (horizon / (nodes - 2) / TICK)
    after = _hermite(ahead, slope, *_places(nodes - 1, horizon, times))
    back = np.clip(-times / TICK, 0.0, 1.0)[:, None]
    return np.where(back > 0.0, back * before + (1.0 - back) * ahead[0], after)


def _places(
    nodes: int, horizon: float, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Knots left and right of times (T,), and the share of the way between them, (T, 1)."""
    position = np.clip(np.asarray(times, float) / horizon, 0.0, 1.0) * (nodes - 1)
    nearest = np.rint(position)  # a time on a knot is on it, however it was rounded
    position = np.where(np.abs(position - nearest) < 1e-9, nearest, position)
    left = np.minimum(position.astype(int), max(nodes - 2, 0))
    right = np.minimum(left + 1, nodes - 1)
    return left, right, (position - left)[:, None]


def _hermite(
    knot: np.ndarray, slope: np.ndarray, left: np.ndarray, right: np.ndarray, u: np.ndarray
) -> np.ndarray:
    return (
        (2 * u**3 - 3 * u**2 + 1) * knot[left]
        + (u**3 - 2 * u**2 + u) * slope[left]
        + (3 * u**2 - 2 * u**3) * knot[right]
        + (u**3 - u**2) * slope[right]
    )


def _finite_difference_slopes(knot: np.ndarray) -> np.ndarray:
    """Slopes per node spacing: central differences inside, one-sided at the ends."""
    if len(knot) < 2:
        return np.zeros_like(knot)
    padded = np.concatenate([knot[:1], knot, knot[-1:]])
    slopes = (padded[2:] - padded[:-2]) * 0.5
    slopes[[0, -1]] *= 2.0
    return slopes
