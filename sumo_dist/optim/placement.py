"""Where the candidates of a plan are put: a prototype, to compare ways of drawing them.

A placement is a text of words joined by "+": mirror, orth, sobol, latin, blocks, anneal, far3, near8, rest4, held8.
"""

import re
from statistics import NormalDist

import numpy as np

from sumo_dist.optim.optimizer import Belief

_QUANTILE = np.vectorize(NormalDist().inv_cdf, otypes=[float])


class Placement:
    def __init__(self, text: str, base: np.ndarray, default: np.ndarray) -> None:
        self.counts = {}
        for word in text.split("+"):
            name, number = re.fullmatch(r"([a-z]+)(\d*)", word).groups()
            self.counts[name] = int(number or 1)
        self.base, self.default = base, default

    def has(self, name: str) -> int:
        return self.counts.get(name, 0)

    def sigma(self, sigma: np.ndarray, iteration: int) -> np.ndarray:
        return sigma * 0.5**iteration if self.has("anneal") else sigma

    def sample(
        self, belief: Belief, rollouts: int, rng: np.random.Generator, coloring: np.ndarray
    ) -> np.ndarray:
        white = self._white(rollouts, belief.mean.shape, rng, belief.sigma > 0)
        noise = np.einsum("kj,bjn->bkn", coloring, white)
        noise[0] = 0.0
        rows = np.arange(rollouts)
        if held := self.has("held"):
            noise[-held:] = noise[-held:, -1:]
        if far := self.has("far"):
            noise[1 : 1 + far] *= 3.0
        if near := self.has("near"):
            noise[-near:] /= 3.0
        if self.has("blocks"):
            group = (rows - 1) // 2 % 4
            noise *= np.where(
                self.base, (group != 1)[:, None, None], (group != 0)[:, None, None]
            )
        mean = np.repeat(belief.mean[None], rollouts, axis=0)
        if rest := self.has("rest"):
            mean[1 : 1 + rest] = np.where(belief.sigma > 0, self.default, belief.mean)
        return np.clip(mean + belief.sigma * noise, -1.0, 1.0).astype(np.float32)

    def _white(self, rollouts, shape, rng, searched) -> np.ndarray:
        if self.has("sobol"):
            from scipy.stats import norm, qmc

            power = int(np.ceil(np.log2(rollouts)))
            seeded = np.random.default_rng(rng.integers(2**63))
            points = qmc.Sobol(int(np.prod(shape)), scramble=True, rng=seeded).random_base2(power)
            return norm.ppf(points[:rollouts]).reshape(rollouts, *shape)
        if self.has("latin"):
            count = rollouts - 1
            order = rng.permuted(np.tile(np.arange(count), (int(np.prod(shape)), 1)), axis=1).T
            points = (order + rng.uniform(size=order.shape)) / count
            white = np.zeros((rollouts, *shape))
            white[1:] = _QUANTILE(points).reshape(count, *shape)
            return white
        if not self.has("mirror") and not self.has("orth"):
            return rng.standard_normal((rollouts, *shape))
        count = rollouts // 2 if self.has("mirror") else rollouts - 1
        drawn = rng.standard_normal((count, *shape))
        if self.has("orth"):
            drawn = self._orthogonal(drawn, searched)
        white = np.zeros((rollouts, *shape))
        if self.has("mirror"):
            white[1::2] = drawn
            white[2::2] = -drawn[: (rollouts - 1) // 2]
        else:
            white[1:] = drawn
        return white

    @staticmethod
    def _orthogonal(drawn: np.ndarray, searched: np.ndarray) -> np.ndarray:
        """Turn the directions of (P, K, n) orthogonal in what is searched, keeping lengths."""
        flat = drawn[:, searched]
        directions = np.linalg.qr(flat.T)[0].T  # (P, d)
        signs = np.sign(np.einsum("pd,pd->p", directions, flat))
        made = np.zeros_like(drawn)
        made[:, searched] = directions * (signs * np.linalg.norm(flat, axis=1))[:, None]
        return made
