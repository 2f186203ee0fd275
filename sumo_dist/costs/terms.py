"""A cost is a table of terms over named arrays; reductions are stated per term."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from sumo_dist.costs.blame import caller, values_of
from sumo_dist.costs.fields import checked_name, checked_number
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
        made: file and line of the code that made the term, "" if it is ours.
    """

    name: str
    residual: Callable[[View], np.ndarray]
    weight: float
    reduction: Reduction = "mean"
    made: str = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        checked_name("cost term", self.name)
        object.__setattr__(self, "made", caller())
        if not callable(self.residual):
            raise UsageError(f"{self.what}: its residual must be a function, got {self.residual!r}")
        checked_number(f"weight of {self.what}", self.weight)
        if self.reduction not in get_args(Reduction):
            raise UsageError(
                f"{self.what}: {unknown('reduction', self.reduction, get_args(Reduction))}"
            )

    @property
    def what(self) -> str:
        """What messages call it."""
        return f"cost term {self.name!r}"

    def evaluate(self, view: View) -> np.ndarray:
        """Return the reduced residual of each rollout, unweighted, (B,).

        Raises:
            TaskError: the residual raises, or returns what is no (B, T).
        """
        return _reduce(values_of(self.what, self.residual, view, self.made), self.reduction)

    def course(self, view: View) -> np.ndarray:
        """Return what each step adds to the reduced residual, unweighted, (B, T).

        Its mean over the steps is what `evaluate` returns; of "any" it is whether it holds, and
        the largest is.

        Raises:
            TaskError: as of `evaluate`.
        """
        values = values_of(self.what, self.residual, view, self.made)
        if self.reduction in INDICATORS:
            return values.astype(bool).astype(float)
        values = values.astype(float)
        return (
            values * values.mean(axis=1, keepdims=True)
            if self.reduction == "squared_mean"
            else values
        )


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
