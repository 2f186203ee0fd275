"""Improved cross-entropy method: elites are kept, and the belief changes gradually."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.optim.optimizer import Belief

MOMENTUM = 0.1  # share of the old belief that an update keeps (paper: alpha)


@dataclass(frozen=True)
class EliteBelief(Belief):
    """A belief and the elites it was fitted to.

    Attributes:
        knots: (E, K, n) float32, best first.
        costs: (E,), finite.
    """

    knots: np.ndarray
    costs: np.ndarray


@dataclass(frozen=True)
class ImprovedCrossEntropy:
    """ICEM (Pinneri et al. 2020) within one plan.

    Its coloured noise, shrinking populations and executing the best candidate are settings of the
    planner, which any optimizer can have. Here are the other two: elites compete in the next
    iteration again, and the belief keeps a share of what it was. It departs from the paper where

    - elites keep their costs instead of being rolled out again: in one plan all candidates start
      from the same state, so the cost would come out the same;
    - all elites are kept, not 30 % of them, as there are few;
    - none are kept from plan to plan: what comes from the last plan is the plan that it executed.
    """

    elites: int = 3

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Refit mean and sigma to the best of the new candidates and the elites before them."""
        if not np.isfinite(costs).any():
            return belief
        if isinstance(belief, EliteBelief):
            knots = np.concatenate([belief.knots, knots])
            costs = np.concatenate([belief.costs, costs])
        order = np.argsort(costs, kind="stable")[: self.elites]
        order = order[np.isfinite(costs[order])]
        best = knots[order].astype(float)  # (E, K, n)
        mean = MOMENTUM * belief.mean + (1.0 - MOMENTUM) * best.mean(axis=0)
        sigma = MOMENTUM * belief.sigma + (1.0 - MOMENTUM) * best.std(axis=0)
        return EliteBelief(mean, sigma, knots[order], costs[order])
