"""Numbers of a cost that may change between two plans: weights of its terms, and parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sumo_dist.costs.parameters import Number, Parameter, Parameters
from sumo_dist.costs.terms import CostTerm
from sumo_dist.errors import UsageError, unknown


@dataclass(frozen=True, eq=False)
class CostSettings:
    """What a plan's question says of its cost.

    Attributes:
        weights: (n_terms,) in the order of the task's terms.
        parameters: (n,) all numbers of all parameters, in the order the task declares them.
    """

    weights: np.ndarray
    parameters: np.ndarray

    def same(self, other: Self) -> bool:
        """Whether both have the same numbers."""
        return np.array_equal(self.weights, other.weights) and np.array_equal(
            self.parameters, other.parameters
        )


class CostTable:
    """The numbers that a task declares: what they are called and what they may be."""

    def __init__(self, terms: Sequence[CostTerm], parameters: Sequence[Parameter]) -> None:
        """Take a task's terms and parameters.

        Raises:
            UsageError: what stands among the parameters is none, or two have the same name.
        """
        if not all(isinstance(parameter, Parameter) for parameter in parameters):
            raise UsageError(f"parameters must be a tuple of Parameter, got {parameters!r:.80}")
        self.terms = tuple(term.name for term in terms)
        self.parameters = {parameter.name: parameter for parameter in parameters}
        if len(self.parameters) != len(parameters):
            raise UsageError(f"parameters need distinct names, got {[p.name for p in parameters]}")
        ends = np.cumsum([parameter.size for parameter in parameters], dtype=int)
        self._slices = {
            p.name: slice(int(end) - p.size, int(end))
            for p, end in zip(parameters, ends, strict=True)
        }
        self.defaults = CostSettings(
            np.array([term.weight for term in terms], float),
            np.concatenate([np.empty(0), *(p.checked(p.default) for p in parameters)]),
        )

    def named(self, parameters: np.ndarray) -> Parameters:
        """Name the numbers (n,) of a question's parameters."""
        values = {name: parameters[part] for name, part in self._slices.items()}
        single = {name for name, p in self.parameters.items() if np.ndim(p.default) == 0}
        return Parameters({n: float(v[0]) if n in single else v for n, v in values.items()})

    def with_weight(self, settings: CostSettings, name: str, weight: float) -> CostSettings:
        """Return settings in which a term has another weight.

        Raises:
            UsageError: there is no such term, or the weight is not finite.
        """
        if name not in self.terms:
            raise unknown("cost term", name, self.terms)
        if not np.isfinite(weight):
            raise UsageError(f"weight of {name!r} must be a finite number, got {weight}")
        weights = settings.weights.copy()
        weights[self.terms.index(name)] = weight
        return replace(settings, weights=weights)

    def with_parameter(self, settings: CostSettings, name: str, value: Number) -> CostSettings:
        """Return settings in which a parameter has another value.

        Raises:
            UsageError: there is no such parameter, or the value is none of its.
        """
        if name not in self.parameters:
            raise unknown("parameter", name, self.parameters)
        parameters = settings.parameters.copy()
        parameters[self._slices[name]] = self.parameters[name].checked(value)
        return replace(settings, parameters=parameters)

    def adjusted(
        self, weight: Sequence[str], param: Sequence[str], settings: CostSettings | None = None
    ) -> CostSettings:
        """Return settings, by default the task's, with changes such as "goal=80", "goal=1,0".

        Raises:
            UsageError: a text is not of that form, or names nothing that the task declares.
        """
        settings = settings or self.defaults
        for text in weight:
            name, numbers = assignment("weight", text)
            if len(numbers) != 1:
                raise UsageError(f"weight {text!r} needs one number")
            settings = self.with_weight(settings, name, numbers[0])
        for text in param:
            name, numbers = assignment("param", text)
            settings = self.with_parameter(settings, name, numbers)
        return settings

    def texts(self, settings: CostSettings) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the changes that make the defaults into some settings; see `adjusted`."""
        before = self.defaults
        weights = zip(self.terms, settings.weights, before.weights, strict=True)
        changed = [
            (name, settings.parameters[part])
            for name, part in self._slices.items()
            if not np.array_equal(settings.parameters[part], before.parameters[part])
        ]
        return (
            tuple(f"{name}={float(now)!r}" for name, now, usual in weights if now != usual),
            tuple(f"{name}={','.join(map(repr, value.tolist()))}" for name, value in changed),
        )

    def check(self, settings: CostSettings) -> CostSettings:
        """Return settings that came from elsewhere if they can be this task's.

        Raises:
            UsageError: they have other sizes, or a number that is none of a parameter's.
        """
        sizes = settings.weights.shape, settings.parameters.shape
        wanted = self.defaults.weights.shape, self.defaults.parameters.shape
        if sizes != wanted:
            raise UsageError(
                f"weights and parameters have shapes {sizes}, this task's have {wanted}"
            )
        if not np.isfinite(settings.weights).all():
            raise UsageError("a weight is not a finite number")
        for name, part in self._slices.items():
            self.parameters[name].checked(settings.parameters[part])
        return settings


def assignment(what: str, text: str) -> tuple[str, tuple[float, ...]]:
    """Read "name=1" or "name=1,2"; a UsageError that begins with `what` if it is neither."""
    name, equals, values = text.partition("=")
    try:
        numbers = tuple(float(value) for value in values.split(","))
    except ValueError:
        numbers = ()
    if not equals or not numbers:
        raise UsageError(
            f"{what} {text!r} is not of the form name=number or name=number,number,..."
        )
    return name.strip(), numbers
