"""Plans from one recorded snapshot, for timing them in this process and over Zenoh alike."""

from collections.abc import Iterator
from contextlib import contextmanager

from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task
from sumo_dist.timing import anchor_tick


def request(snapshot: Snapshot, number: int) -> PlanRequest:
    """Ask for plan `number`, from 1 on: always from the snapshot's state, each with other noise."""
    before = number - 1
    previous = Plan(before, anchor_tick(before), snapshot.knots, snapshot.horizon, snapshot.spline)
    return PlanRequest(number, anchor_tick(number), snapshot.state, snapshot.memory, previous)


@contextmanager
def in_process(episode: EpisodeConfig, threads: int) -> Iterator[LocalPlanning]:
    """Yield the planner of an episode with rollouts in this process."""
    task = load_task(episode.task)
    problem = Problem.build(task, planning_options(episode.planner))
    with problem.engine(threads, episode.engine) as engine:
        yield LocalPlanning(
            Planner(episode.planner, task.actions, episode.seed),
            Evaluator(problem, engine, episode.planner),
        )
