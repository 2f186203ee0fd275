"""Model predictive path integral control."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.optim.optimizer import Belief


@dataclass(frozen=True)
class PathIntegral:
    """Exponentially weighted mean of all samples.

    Attributes:
        temperature: in units of the costs' spread, so that one value serves costs of any scale. The
            spread is that of the better half, see `lower_deviation`: a candidate that falls costs
            a hundred times the others and says nothing about which of them to prefer.
    """

    temperature: float = 0.1

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Move the mean by softmax(-costs / temperature); sigma stays."""
        finite = np.isfinite(costs)
        if not finite.any():
            return belief
        relative = costs[finite] - costs[finite].min()
        scale = self.temperature * lower_deviation(relative)
        weights = np.exp(-relative / scale) if scale > 0 else (relative == 0).astype(float)
        weights /= weights.sum()
        mean = (weights[:, None, None] * knots[finite].astype(float)).sum(axis=0)
        return Belief(mean, belief.sigma)


def lower_deviation(costs: np.ndarray) -> float:
    """Return the root mean square of how far the better half of costs (B,) lies below the median.

    That is the standard deviation where costs lie evenly about their median; no cost above the
    median changes it. Of an even number, the median is the lower of the two in the middle.
    """
    better = np.sort(costs)[: (len(costs) + 1) // 2]
    return float(np.sqrt(np.mean((better[-1] - better) ** 2)))
