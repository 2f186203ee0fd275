"""Parameters of a task: named numbers that may change between two plans."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sumo_dist.errors import UsageError, unknown

Number = float | tuple[float, ...]


@dataclass(frozen=True)
class Parameter:
    """A number, or a few, that residuals, resets and success tests read as `r.p.name`.

    Attributes:
        name: a Python identifier.
        default: a number, or a tuple of them.
        unit: such as "m" or "rad".
        range: lowest and highest value of each number.
    """

    name: str
    default: Number
    unit: str = ""
    range: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        name = self.name
        if not isinstance(name, str) or not name.isidentifier() or name.startswith("_"):
            raise UsageError(f"parameter {name!r}: its name must be a Python identifier")
        if not _is_range(self.range):
            raise UsageError(
                f"parameter {name!r}: its range must be (low, high) with low < high, "
                f"got {self.range!r}"
            )
        self.checked(self.default)

    @property
    def size(self) -> int:
        """How many numbers it is."""
        return int(np.size(self.default))

    def checked(self, value: Number | np.ndarray) -> np.ndarray:
        """Return a value as an array (size,), or raise an error that says what is valid."""
        try:
            numbers = np.atleast_1d(np.asarray(value, float))
        except (TypeError, ValueError):
            numbers = np.array([np.nan])
        low, high = self.range
        if numbers.shape != (self.size,) or not np.isfinite(numbers).all():
            count = "a finite number" if self.size == 1 else f"{self.size} finite numbers"
            raise UsageError(f"parameter {self.name!r} needs {count}, got {value!r}")
        if (numbers < low).any() or (numbers > high).any():
            unit = f" {self.unit}" if self.unit else ""
            raise UsageError(
                f"parameter {self.name!r} must be from {low:g} to {high:g}{unit}, got {value}"
            )
        return numbers


class Parameters:
    """Values of a task's parameters, as attributes: a number, or an array (n,)."""

    def __init__(self, values: Mapping[str, float | np.ndarray]) -> None:
        """Hold values by name."""
        self._values = values

    def __getattr__(self, name: str) -> Any:
        """Return a parameter's value, or say which there are."""
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._values:
            raise unknown("parameter", name, self._values)
        return self._values[name]


NO_PARAMETERS = Parameters({})


def _is_range(value: Any) -> bool:
    """Whether a value is (low, high): infinite ends are open."""
    try:
        low, high = value
        return bool(low < high)
    except (TypeError, ValueError):
        return False
