import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task


@pytest.fixture(scope="session")
def config():
    return PlannerConfig(rollouts=12, horizon=0.5)


@pytest.fixture(scope="session")
def problem(config):
    return Problem.build(load_task("spot/move_box"), planning_options(config))


@pytest.fixture(scope="session")
def start(problem):
    """State and policy memory at the start of seed 5."""
    return draw_start(problem.task, seed=5), problem.policy.initial_memory()


@pytest.fixture(scope="session")
def engine(problem):
    with problem.engine(threads=1) as engine:
        yield engine


@pytest.fixture(scope="session")
def evaluator(problem, engine, config):
    return Evaluator(problem, engine, config)
