"""What a sampling optimizer is: propose knots around a mean, update the mean from costs."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True)
class Belief:
    """A Gaussian over plans, independent per node and dimension, in normalised actions.

    Attributes:
        mean: (K, n) knots; (B, K, n) where each of B candidates is drawn around its own.
        sigma: (K, n) standard deviations; 0 is not searched.
    """

    mean: np.ndarray
    sigma: np.ndarray


class Optimizer(Protocol):
    """One sampling-based optimizer; it keeps no state between calls.

    What it learns from iteration to iteration of a plan is in the belief, which it may extend; the
    first update of a plan is given a plain one.
    """

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Improve the belief from costs (B,), best is lowest, of knots (B, K, n); +inf is lost."""
        ...


def noise_ramp(first: float, last: float, nodes: int, size: int) -> np.ndarray:
    """Standard deviations (K, n) whose VARIANCE rises linearly over the nodes (paper)."""
    return np.repeat(np.sqrt(np.linspace(first, last, nodes))[:, None], size, axis=1)


def coloring(exponent: float, nodes: int) -> np.ndarray:
    """Matrix (K, K) that turns white noise over the nodes into coloured noise of unit variance.

    Its power falls as 1 / frequency^exponent; 0 is white, 2 wanders. The correlation is that of a
    period of four horizons, so that the last node is not tied to the first.
    """
    frequency = np.fft.rfftfreq(4 * nodes)
    frequency[0] = frequency[1]
    correlation = np.fft.irfft(frequency**-exponent)[:nodes]  # Wiener-Khinchin
    correlation = np.round(correlation / correlation[0], 12)  # white is exactly white
    lag = np.abs(np.subtract.outer(np.arange(nodes), np.arange(nodes)))
    return np.linalg.cholesky(correlation[lag])


def sample(
    belief: Belief,
    rollouts: int,
    rng: np.random.Generator,
    coloring: np.ndarray,
    shares: np.ndarray,
) -> np.ndarray:
    """Draw knots (B, K, n) float32, clipped to [-1, 1]; row 0 is its unperturbed mean.

    Args:
        belief: what is drawn from.
        rollouts: B.
        rng: decides the draw.
        coloring: (K, K), see `coloring`.
        shares: (B,) of the noise that each candidate has, see `noise_shares`.
    """
    white = rng.standard_normal((rollouts, *belief.sigma.shape))
    noise = np.einsum("kj,bjn->bkn", coloring, white)
    noise[0] = 0.0
    return np.clip(belief.mean + belief.sigma * noise * shares[:, None, None], -1.0, 1.0).astype(
        np.float32
    )
