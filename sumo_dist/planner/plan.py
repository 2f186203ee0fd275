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
        tick: policy tick of the first knot.
        knots: (K, n) float32 normalised actions.
        horizon: [s].
        spline: interpolation order.
    """

    number: int
    tick: int
    knots: np.ndarray
    horizon: float
    spline: splines.Order

    def at(self, ticks: np.ndarray) -> np.ndarray:
        """Normalised actions (T, n) at some ticks; the end knots hold outside the horizon."""
        return self.at_times((np.asarray(ticks) - self.tick) * TICK)

    def at_times(self, times: np.ndarray) -> np.ndarray:
        """Normalised actions (T, n) at some times since the first knot [s]."""
        return splines.evaluate(
            splines.weights(self.spline, len(self.knots), self.horizon, times), self.knots
        )
