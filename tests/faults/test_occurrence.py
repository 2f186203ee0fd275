"""How long planning took to resume, where faults overlap."""

import pytest

from sumo_dist.faults.occurrence import Blow, waited
from sumo_dist.faults.script import Fault

DROP = Fault("drop", 1)


def blow(began, ended, resumed=None):
    return Blow(DROP, began, ended, resumed)


@pytest.mark.parametrize(
    ("others", "expected"),
    [
        ([], 3.0),
        ([blow(0.0, 1.5, 1.6), blow(5.5, 6.0, 6.1)], 3.0),  # over before it, begun after it
        ([blow(1.0, 4.5, 5.0)], 0.5),  # active at its end
        ([blow(3.0, 4.0, 5.0)], 1.0),  # begun before planning resumed
        ([blow(3.0, 3.5, 5.0), blow(1.0, 4.0, 5.0)], 1.0),  # the last of them counts
        ([blow(1.0, 9.0, 9.1)], 0.0),  # resumed in spite of it
        ([blow(1.0, None)], 0.0),
    ],
)
def test_the_clock_starts_at_the_end_of_the_last_overlapping_fault(others, expected):
    one = blow(1.0, 2.0, 5.0)
    assert waited(one, [one, *others], until=20.0) == pytest.approx(expected)


def test_a_fault_that_is_not_over_has_no_wait():
    one = blow(1.0, None)
    assert waited(one, [one], until=20.0) is None


def test_planning_that_never_resumes_has_waited_until_the_run_ended():
    one = blow(1.0, 2.0)
    assert waited(one, [one], until=20.0) == 18.0
    assert waited(one, [one, blow(3.0, None)], until=20.0) is None
    assert waited(one, [one], until=None) is None
