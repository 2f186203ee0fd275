"""A cost is a table of terms over named arrays; reductions are stated per term."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from sumo_dist.costs.view import View
from sumo_dist.errors import UsageError, unknown

Reduction = Literal["mean", "squared_mean", "any", "share"]
INDICATORS = ("any", "share")  # reductions of functions that are true or false


@dataclass(frozen=True)
class CostTerm:
    """weight * reduction over steps of residual(view).

    Attributes:
        name: shown in plots and tables.
        residual: View -> (B, T).
        weight: unless a question says otherwise; negative for a reward.
        reduction: "mean" over the T steps; "squared_mean", the square of that mean; "any", an
            indicator that counts once, unscaled, however long it holds; "share", an indicator that
            counts by the share of the steps at which it holds.
    """

    name: str
    residual: Callable[[View], np.ndarray]
    weight: float
    reduction: Reduction = "mean"

    def __post_init__(self) -> None:
        if self.reduction not in get_args(Reduction):
            raise unknown("reduction", self.reduction, get_args(Reduction))

    def evaluate(self, view: View) -> np.ndarray:
        """Return the reduced residual of each rollout, unweighted, (B,)."""
        values = np.asarray(self.residual(view))
        if values.shape != view.actions.shape[:2]:
            raise UsageError(
                f"cost term {self.name!r} returned shape {values.shape}, "
                f"must be (rollouts, steps) = {view.actions.shape[:2]}"
            )
        return _reduce(values, self.reduction)


def evaluate(terms: tuple[CostTerm, ...], view: View) -> np.ndarray:
    """Reduced residual of every term for every rollout, unweighted, (B, n_terms)."""
    return np.stack([term.evaluate(view) for term in terms], axis=1)


def norm(vectors: np.ndarray) -> np.ndarray:
    """Euclidean norm over the last axis, summed in a fixed order."""
    total = vectors[..., 0] * vectors[..., 0]
    for i in range(1, vectors.shape[-1]):
        total = total + vectors[..., i] * vectors[..., i]
    return np.sqrt(total)


def _reduce(values: np.ndarray, reduction: Reduction) -> np.ndarray:
    if reduction == "any":
        return values.astype(bool).any(axis=1).astype(float)
    if reduction == "share":
        values = values.astype(bool)
    # Contiguous rows: numpy then sums each row alone, in the same order whatever the batch.
    mean = np.ascontiguousarray(values, dtype=float).mean(axis=1)
    return mean * mean if reduction == "squared_mean" else mean
