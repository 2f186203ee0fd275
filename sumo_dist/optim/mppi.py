"""Model predictive path integral control."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.optim.optimizer import Belief


@dataclass(frozen=True)
class PathIntegral:
    """Exponentially weighted mean of all samples.

    Attributes:
        temperature: in units of the costs' spread (standard deviation over the samples), so that
            one value serves costs of any scale.
    """

    temperature: float = 0.1

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Move the mean by softmax(-costs / temperature); sigma stays."""
        finite = np.isfinite(costs)
        if not finite.any():
            return belief
        relative = costs[finite] - costs[finite].min()
        spread = relative.std()
        weights = (
            np.exp(-relative / (self.temperature * spread))
            if spread > 0
            else np.ones_like(relative)
        )
        weights /= weights.sum()
        mean = (weights[:, None, None] * knots[finite].astype(float)).sum(axis=0)
        return Belief(mean, belief.sigma)
