"""Predictive sampling."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.optim.optimizer import Belief


@dataclass(frozen=True)
class PredictiveSampling:
    """The best sample becomes the mean (Howell et al. 2022)."""

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Take the best sample; sigma stays."""
        best = int(np.argmin(costs))
        return (
            Belief(knots[best].astype(float), belief.sigma) if np.isfinite(costs[best]) else belief
        )
