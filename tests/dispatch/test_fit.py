import pytest

from sumo_dist.dispatch.fit import MOST_PERIODS, fitted, periods
from sumo_dist.dispatch.pace import Pace
from sumo_dist.planner.config import PlannerConfig


@pytest.mark.parametrize(
    ("pace", "budget", "rollouts"),
    [
        (1.0, 46.0, 32),  # all fit
        (0.5, 46.0, 17),
        (0.5, 460.0, 32),
        (0.0, 46.0, 4),  # nobody is there: the fewest that say something
        (1.0, -3.0, 4),
    ],
)
def test_as_many_as_fit(pace, budget, rollouts):
    assert fitted(PlannerConfig(rollouts=32), [Pace(pace)], budget) == rollouts


def test_the_way_to_a_worker_is_no_time_for_rollouts():
    assert fitted(PlannerConfig(rollouts=32), [Pace(0.5, wait_ms=20.0)], 46.0) == 9
    assert fitted(PlannerConfig(rollouts=32), [Pace(0.5), Pace(9.0, wait_ms=50.0)], 46.0) == 17


def test_no_fewer_than_the_optimizer_needs():
    assert fitted(PlannerConfig("cem", elites=9), [], 46.0) == 10
    assert fitted(PlannerConfig(iterations=7), [], 46.0) == 7


def test_more_workers_never_mean_fewer_rollouts():
    fits = [fitted(PlannerConfig(), [Pace(0.1)] * count, 46.0) for count in range(20)]
    assert fits == sorted(fits)


@pytest.mark.parametrize(
    ("paces", "expected"),
    [
        ([], 1),
        ([Pace(1.0, 2.0)], 1),
        ([Pace(1.0, 20.0)], 1),
        ([Pace(1.0, 40.0)], 2),
        ([Pace(1.0, 100.0)], 3),
        ([Pace(1.0, 1e6)], MOST_PERIODS),
        ([Pace(1.0, 1.0), Pace(1.0, 100.0)], 1),  # those near are half of all
        ([Pace(1.0, 1.0), Pace(3.0, 100.0)], 3),
    ],
)
def test_a_plan_takes_as_many_periods_as_leave_time_for_rollouts(paces, expected):
    assert periods(paces, 50.0, 4.0) == expected
