"""Success as data: what is measured, and below which parameter of the task it has to be."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.costs.parameters import Parameters
from sumo_dist.costs.view import View
from sumo_dist.tasks.terms import Residual


@dataclass(frozen=True)
class Measure:
    """Something that is to become small.

    Attributes:
        name: shown in plots, such as "object to goal".
        value: View -> (B, T), in the unit of the limit.
        limit: the task's parameter that the value must be below.
    """

    name: str
    value: Residual
    limit: str

    def allowed(self, p: Parameters) -> float:
        """Return the limit under a task's parameters."""
        return getattr(p, self.limit)


class AllBelow:
    """A success test that holds while every measure is below its limit.

    Attributes:
        measures: what the viewer plots as the task's progress.
    """

    def __init__(self, *measures: Measure) -> None:
        """Test some measures."""
        self.measures = measures

    def __call__(self, r: View) -> np.ndarray:
        """Whether all are below their limits, (B, T) bool."""
        below = [measure.value(r) < measure.allowed(r.p) for measure in self.measures]
        return np.logical_and.reduce(below)
