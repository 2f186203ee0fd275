"""A plan: a spline of normalised actions, anchored on a tick of robot time."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.math import splines
from sumo_dist.timing import TICK


@dataclass(frozen=True)
class Plan:
    """Knots over the horizon that starts at a tick.

    Attributes:
        number: plans are counted from 0.
        tick: policy tick at which it starts.
        knots: (K, n) float32 normalised actions, at `splines.knot_times`.
        horizon: [s].
        spline: interpolation order.
    """

    number: int
    tick: int
    knots: np.ndarray
    horizon: float
    spline: splines.Order

    def at(self, ticks: np.ndarray) -> np.ndarray:
        """Normalised actions (T, n) at some ticks; the end knots hold beyond them."""
        return self.at_times((np.asarray(ticks) - self.tick) * TICK)

    def at_times(self, times: np.ndarray) -> np.ndarray:
        """Normalised actions (T, n) at some times since the start [s]."""
        return actions_of(
            splines.weights(self.spline, len(self.knots), self.horizon, times), self.knots
        )


def actions_of(weights: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Normalised actions (..., T, n) of knots (..., K, n), by the weights (T, K) of their spline.

    A cubic between knots at the end of the range would leave it; an action never does.
    """
    return np.clip(splines.evaluate(weights, knots), -1.0, 1.0)
