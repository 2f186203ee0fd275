import pytest

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task


@pytest.fixture(scope="session")
def config():
    return PlannerConfig(rollouts=10, horizon=0.4)


@pytest.fixture(scope="session")
def problem(config):
    return Problem.build(load_task("spot/move_box"), planning_options(config))
