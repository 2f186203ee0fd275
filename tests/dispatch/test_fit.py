import pytest

from sumo_dist.dispatch.fit import fitted
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
    assert fitted(PlannerConfig(rollouts=32), pace, budget) == rollouts


def test_no_fewer_than_the_optimizer_needs():
    assert fitted(PlannerConfig("cem", elites=9), 0.0, 46.0) == 10
    assert fitted(PlannerConfig(iterations=7), 0.0, 46.0) == 7


def test_more_workers_never_mean_fewer_rollouts():
    fits = [fitted(PlannerConfig(), pace / 10, 46.0) for pace in range(20)]
    assert fits == sorted(fits)
