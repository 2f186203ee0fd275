from dataclasses import replace

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.episode.single import run_single
from sumo_dist.learn.environment import Environment, EnvironmentConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task

SMALL = EnvironmentConfig(count=6, starts=4)


@pytest.fixture(scope="session")
def problem():
    return Problem.build(load_task("spot/move_box"), planning_options(PlannerConfig()))


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Folder of a short run of the box task, said to have ended in success."""
    config = EpisodeConfig("spot/move_box", seed=1, time_limit=0.4)
    recording, _ = run_single(config, threads=1)
    recording.ending = End.SUCCESS
    folder = tmp_path_factory.mktemp("runs") / "one"
    folder.mkdir()
    recording.save(folder / "run.npz")
    return folder


@pytest.fixture
def begin(problem):
    """Make an environment of a few episodes of the box task; all of them are closed."""
    made = []

    def begin(weight=(), param=(), threads=1, seed=1, problem=problem, **changes):
        cost = problem.task.table.adjusted(weight, param)
        made.append(Environment(problem, cost, replace(SMALL, **changes), seed, threads))
        return made[-1]

    yield begin
    for environment in made:
        environment.__exit__()
