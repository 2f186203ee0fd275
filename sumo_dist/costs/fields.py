"""Checks of what a task's author writes: names that can be typed, numbers that are numbers."""

import math
from numbers import Real
from typing import Any

from sumo_dist.errors import UsageError


def checked_name(what: str, name: Any) -> str:
    """Return a name that can be typed as name=value and printed in a line.

    Raises:
        UsageError: it is none.
    """
    if not isinstance(name, str) or not name.isprintable() or name.strip() != name or not name:
        raise UsageError(f"{what} needs a name in one line, without spaces around it, got {name!r}")
    if "=" in name:
        raise UsageError(f"{what} {name!r}: its name must be without '='")
    return name


def checked_number(what: str, value: Any, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a number that is finite and from low to high.

    Raises:
        UsageError: it is none; the message says what it is of.
    """
    finite = _finite(value)
    if finite is None or not low <= finite <= high:
        bounds = f" from {low:g} to {high:g}" if math.isfinite(high) else f" from {low:g} on"
        wanted = f"a finite number{bounds if math.isfinite(low) else ''}"
        raise UsageError(f"{what} must be {wanted}, got {value!r}")
    return finite


def _finite(value: Any) -> float | None:
    """Return a number that is one, and finite; a text or a truth is none."""
    if not isinstance(value, Real) or isinstance(value, bool):
        return None
    try:
        number = float(value)
    except OverflowError:  # a whole number that no float can hold
        return None
    return number if math.isfinite(number) else None
