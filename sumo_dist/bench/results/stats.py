"""Success rates and whether they differ: intervals and exact tests for small samples."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

ALPHA = 0.05  # a difference is significant below this
BOOTSTRAPS = 5000
Z95 = 1.959964  # standard normal quantile of a two-sided 95 % interval


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Wilson's 95 % score interval of a success rate."""
    rate, z2 = successes / trials, Z95**2 / trials
    center = (rate + z2 / 2) / (1 + z2)
    half = Z95 / (1 + z2) * math.sqrt(rate * (1 - rate) / trials + z2 / (4 * trials))
    return max(0.0, center - half), min(1.0, center + half)


class Ratio(NamedTuple):
    """How the second of two paired samples compares with the first."""

    pairs: int
    value: float  # Hodges-Lehmann estimate of second / first
    low: float  # its 95 % interval, from 0 to infinity where there are too few pairs for one
    high: float
    p: float  # of Wilcoxon's signed-rank test, exact and two-sided


def fisher(successes: tuple[int, int], trials: tuple[int, int]) -> float:
    """Two-sided p of Fisher's exact test that two success rates are the same."""
    total = sum(successes)
    ways = {
        k: math.comb(trials[0], k) * math.comb(trials[1], total - k)
        for k in range(max(0, total - trials[1]), min(total, trials[0]) + 1)
    }
    observed = ways[successes[0]]
    return sum(n for n in ways.values() if n <= observed) / sum(ways.values())


def newcombe(successes: tuple[int, int], trials: tuple[int, int]) -> tuple[float, float]:
    """Newcombe's 95 % interval of the second success rate minus the first, from Wilson's two."""
    (p, low_p, high_p), (q, low_q, high_q) = (
        (k / n, *wilson(k, n)) for k, n in zip(successes, trials, strict=True)
    )
    low = q - p - math.hypot(q - low_q, high_p - p)
    high = q - p + math.hypot(high_q - q, p - low_p)
    return low, high


def bootstrap_ratio(
    numerators: Sequence[float], denominators: Sequence[float]
) -> tuple[float, float]:
    """95 % interval of the ratio of two sums over the same samples, by the bootstrap.

    Returns:
        Its ends; infinite where the samples drawn may have a sum of denominators that is 0.
    """
    n = len(numerators)
    drawn = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), BOOTSTRAPS)  # how often each
    above, below = (drawn @ np.array(sums, float) for sums in (numerators, denominators))
    ratios = np.divide(above, below, out=np.full(BOOTSTRAPS, np.inf), where=below > 0)
    low, high = np.quantile(ratios, (0.025, 0.975), method="inverted_cdf")  # between infinities
    return float(low), float(high)


def paired_ratio(first: Sequence[float], second: Sequence[float]) -> Ratio:
    """Compare two samples of positive values, pair by pair, on a logarithmic scale."""
    logs = [math.log(b / a) for a, b in zip(first, second, strict=True)]
    n = len(logs)
    walsh = sorted((logs[i] + logs[j]) / 2 for i in range(n) for j in range(i, n))
    middle = (walsh[(len(walsh) - 1) // 2] + walsh[len(walsh) // 2]) / 2
    # Walsh averages below the interval's end: as many as signed ranks have sums in the lower tail.
    below, outside = 0, _ways(range(1, n + 1))
    while sum(outside[: below + 1]) / 2**n <= ALPHA / 2:
        below += 1
    low, high = (math.exp(walsh[below - 1]), math.exp(walsh[-below])) if below else (0.0, math.inf)
    return Ratio(n, math.exp(middle), low, high, signed_rank(logs))


def signed_rank(differences: Sequence[float]) -> float:
    """Two-sided p of Wilcoxon's signed-rank test, exact also with ties; zeros say nothing."""
    values = sorted((d for d in differences if d), key=abs)
    sizes = [abs(value) for value in values]
    # Twice the rank, so that the mean rank of ties is a whole number.
    ranks = [2 * sizes.index(size) + sizes.count(size) + 1 for size in sizes]
    positive = sum(rank for rank, value in zip(ranks, values, strict=True) if value > 0)
    ways, extreme = _ways(ranks), min(positive, sum(ranks) - positive)
    return min(1.0, 2 * sum(ways[: extreme + 1]) / 2 ** len(ranks))


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjustment: the chance of even one false alarm among all tests stays below ALPHA."""
    adjusted, worst = [0.0] * len(p_values), 0.0
    for tests, i in zip(
        range(len(p_values), 0, -1),
        sorted(range(len(p_values)), key=p_values.__getitem__),
        strict=True,
    ):
        worst = max(worst, min(1.0, tests * p_values[i]))
        adjusted[i] = worst
    return adjusted


def _ways(ranks: Sequence[int]) -> list[int]:
    """How many subsets of the ranks have each sum, from 0 on."""
    ways = [1] + [0] * sum(ranks)
    for rank in ranks:
        for total in range(len(ways) - 1, rank - 1, -1):
            ways[total] += ways[total - rank]
    return ways
