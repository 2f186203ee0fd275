"""Cross-entropy method."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.optim.optimizer import Belief


@dataclass(frozen=True)
class CrossEntropy:
    """Mean and spread of the best few samples (paper, Algorithm 1)."""

    elites: int = 3

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Refit mean and sigma to the elites; the refitted sigma serves inner iterations only."""
        order = np.argsort(costs, kind="stable")[: self.elites]
        best = knots[order[np.isfinite(costs[order])]].astype(float)  # (E, K, n)
        return Belief(best.mean(axis=0), best.std(axis=0)) if len(best) else belief
