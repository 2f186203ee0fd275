"""What a sampling optimizer is: propose knots around a mean, update the mean from costs."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Belief:
    """A Gaussian over plans, independent per node and dimension, in normalised actions.

    Attributes:
        mean: (K, n) knots.
        sigma: (K, n) standard deviations.
    """

    mean: np.ndarray
    sigma: np.ndarray


class Optimizer(Protocol):
    """One sampling-based optimizer; it keeps no state between calls."""

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Improve the belief from costs (B,), best is lowest, of knots (B, K, n); +inf is lost."""
        ...


def noise_ramp(first: float, last: float, nodes: int, size: int) -> np.ndarray:
    """Standard deviations (K, n) whose VARIANCE rises linearly over the nodes (paper)."""
    return np.repeat(np.sqrt(np.linspace(first, last, nodes))[:, None], size, axis=1)


def sample(belief: Belief, rollouts: int, rng: np.random.Generator) -> np.ndarray:
    """Draw knots (B, K, n) float32, clipped to [-1, 1]; row 0 is the unperturbed mean."""
    noise = rng.standard_normal((rollouts, *belief.mean.shape))
    noise[0] = 0.0
    return np.clip(belief.mean + belief.sigma * noise, -1.0, 1.0).astype(np.float32)
