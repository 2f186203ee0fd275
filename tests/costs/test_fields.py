"""Names that can be typed, numbers that are numbers."""

import numpy as np
import pytest

from sumo_dist.costs.fields import checked_name, checked_number
from sumo_dist.errors import UsageError


@pytest.mark.parametrize("value", [0, -2.5, 1e300, np.float32(3), np.int64(4)])
def test_numbers_of_any_kind_are_numbers(value):
    assert checked_number("x", value) == float(value)


@pytest.mark.parametrize(
    "value", ["4", None, np.nan, np.inf, -np.inf, True, 10**400, 1j, [1.0], np.zeros(1)]
)
def test_what_is_no_finite_number_is_refused_by_name(value):
    with pytest.raises(UsageError, match=r"^weight of 'a' must be a finite number, got "):
        checked_number("weight of 'a'", value)


@pytest.mark.parametrize(
    ("low", "high", "bounds"), [(0.0, np.inf, "from 0 on"), (0, 1, "from 0 to 1")]
)
def test_bounds_are_said(low, high, bounds):
    assert checked_number("x", 0, low, high) == 0.0
    with pytest.raises(UsageError, match=f"x must be a finite number {bounds}, got -1"):
        checked_number("x", -1, low, high)


@pytest.mark.parametrize("name", ["", " a", "a\nb", "a=1", 3, None])
def test_a_name_can_be_typed_in_a_line(name):
    assert checked_name("a term", "to goal") == "to goal"
    with pytest.raises(UsageError, match="a term"):
        checked_name("a term", name)
