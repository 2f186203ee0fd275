"""How long planning took to resume, where faults overlap."""

import pytest

from sumo_dist.faults.occurrence import FaultOccurrence, resume_delay
from sumo_dist.faults.script import Fault

DROP = Fault("drop", 1)


def occurrence(began, ended, resumed=None):
    return FaultOccurrence(DROP, began, ended, resumed)


@pytest.mark.parametrize(
    ("others", "expected"),
    [
        ([], 3.0),
        (
            [occurrence(0.0, 1.5, 1.6), occurrence(5.5, 6.0, 6.1)],
            3.0,
        ),  # over before it, begun after it
        ([occurrence(1.0, 4.5, 5.0)], 0.5),  # active at its end
        ([occurrence(3.0, 4.0, 5.0)], 1.0),  # begun before planning resumed
        ([occurrence(3.0, 3.5, 5.0), occurrence(1.0, 4.0, 5.0)], 1.0),  # the last of them counts
        ([occurrence(1.0, 9.0, 9.1)], 0.0),  # resumed in spite of it
        ([occurrence(1.0, None)], 0.0),
    ],
)
def test_the_clock_starts_at_the_end_of_the_last_overlapping_fault(others, expected):
    one = occurrence(1.0, 2.0, 5.0)
    assert resume_delay(one, [one, *others], run_ended=20.0) == pytest.approx(expected)


def test_a_fault_that_is_not_over_has_no_wait():
    one = occurrence(1.0, None)
    assert resume_delay(one, [one], run_ended=20.0) is None


def test_planning_that_never_resumes_has_waited_until_the_run_ended():
    one = occurrence(1.0, 2.0)
    assert resume_delay(one, [one], run_ended=20.0) == 18.0
    assert resume_delay(one, [one, occurrence(3.0, None)], run_ended=20.0) is None
    assert resume_delay(one, [one], run_ended=None) is None
