"""Covariance matrix adaptation with a diagonal covariance."""

import math
from dataclasses import dataclass

import numpy as np

from sumo_dist.optim.optimizer import Belief


@dataclass(frozen=True)
class Evolution(Belief):
    """A belief and what its evolution has gathered.

    Attributes:
        step: global step size; sigma is step times the root of the variances.
        variances: (K, n).
        path: (K, n) weighted sum of the mean's moves, in steps: p_c.
        path_white: (K, n) the same in standard deviations: p_sigma.
        generation: updates so far.
    """

    step: float
    variances: np.ndarray
    path: np.ndarray
    path_white: np.ndarray
    generation: int

    @classmethod
    def start(cls, belief: Belief) -> "Evolution":
        """Begin with a step size of one."""
        zero = np.zeros_like(belief.mean)
        return cls(belief.mean, belief.sigma, 1.0, belief.sigma**2, zero, zero, 0)


@dataclass(frozen=True)
class Rates:
    """Constants of the method (Hansen 2016, table 1; Ros and Hansen 2008 for the diagonal).

    Attributes:
        weights: (mu,) of the best candidates, positive, falling, of sum one.
        mu_eff: how many equally weighted candidates they are worth.
        path, path_white: how fast the paths forget, c_c and c_sigma.
        damping: of the step size, d_sigma.
        rank_one, rank_mu: learning rates of the variances, c_1 and c_mu.
    """

    weights: np.ndarray
    mu_eff: float
    path: float
    path_white: float
    damping: float
    rank_one: float
    rank_mu: float

    @classmethod
    def of(cls, candidates: int, n: int) -> "Rates":
        """Return the constants for a population in n dimensions."""
        mu = max(1, candidates // 2)
        weights = math.log((candidates + 1) / 2) - np.log(np.arange(1, mu + 1))
        weights = weights / weights.sum() if mu > 1 else np.ones(1)
        mu_eff = float(1.0 / (weights**2).sum())
        path_white = (mu_eff + 2) / (n + mu_eff + 5)
        faster = (n + 2) / 3  # a diagonal has that many fewer variances to learn
        rank_one = faster * 2 / ((n + 1.3) ** 2 + mu_eff)
        rank_mu = faster * 2 * (mu_eff - 2 + 1 / mu_eff) / ((n + 2) ** 2 + mu_eff)
        rank_one = min(1.0, rank_one)
        return cls(
            weights=weights,
            mu_eff=mu_eff,
            path=(4 + mu_eff / n) / (n + 4 + 2 * mu_eff / n),
            path_white=path_white,
            damping=1 + 2 * max(0.0, math.sqrt((mu_eff - 1) / (n + 1)) - 1) + path_white,
            rank_one=rank_one,
            rank_mu=min(1.0 - rank_one, rank_mu),
        )


@dataclass(frozen=True)
class CovarianceAdaptation:
    """sep-CMA-ES (Ros and Hansen 2008): recombination, step size and variances are the standard's.

    It departs from the standard where the planner decides: every plan starts again from the
    planner's noise and with empty paths, so that it adapts over the iterations of one plan only;
    the mean is one of its own candidates; candidates beyond the limits are set on them; lost ones
    count as never drawn. With two iterations a plan it is close to a recombination of the better
    half, with weights falling from the best.
    """

    def update(self, belief: Belief, knots: np.ndarray, costs: np.ndarray) -> Belief:
        """Evolve mean, variances and step size; a plain belief begins an evolution."""
        order = np.argsort(costs, kind="stable")
        order = order[np.isfinite(costs[order])]
        if not len(order):
            return belief
        now = belief if isinstance(belief, Evolution) else Evolution.start(belief)
        searched = now.variances > 0.0
        n = int(searched.sum())
        rates = Rates.of(len(order), n)
        best = knots[order[: len(rates.weights)]].astype(float)
        moves = np.where(searched, (best - now.mean) / now.step, 0.0)  # (mu, K, n)
        move = np.einsum("b,bkn->kn", rates.weights, moves)

        path_white = _follow(
            now.path_white,
            move / np.sqrt(np.where(searched, now.variances, 1.0)),
            rates.path_white,
            rates.mu_eff,
        )
        length = float(np.linalg.norm(path_white))
        expected = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))
        step = now.step * math.exp(rates.path_white / rates.damping * (length / expected - 1))

        # While the step size is still growing fast, the path does not count (h_sigma).
        age = 1 - (1 - rates.path_white) ** (2 * (now.generation + 1))
        steady = length / math.sqrt(age) < (1.4 + 2 / (n + 1)) * expected
        path = _follow(now.path, move if steady else np.zeros_like(move), rates.path, rates.mu_eff)
        lost = 0.0 if steady else rates.path * (2 - rates.path)
        variances = (
            (1 - rates.rank_one * (1 - lost) - rates.rank_mu) * now.variances
            + rates.rank_one * path**2
            + rates.rank_mu * np.einsum("b,bkn->kn", rates.weights, moves**2)
        )
        return Evolution(
            mean=now.mean + now.step * move,
            sigma=step * np.sqrt(variances),
            step=step,
            variances=variances,
            path=path,
            path_white=path_white,
            generation=now.generation + 1,
        )


def _follow(path: np.ndarray, move: np.ndarray, rate: float, mu_eff: float) -> np.ndarray:
    return (1 - rate) * path + math.sqrt(rate * (2 - rate) * mu_eff) * move
