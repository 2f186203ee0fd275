"""Plans from one recorded snapshot, for timing them in this process and over Zenoh alike."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import anchor_tick

MakePlan = Callable[[PlanRequest], PlanReport]


def request(episode: Episode, snapshot: Snapshot, number: int) -> PlanRequest:
    """Ask for plan `number`, from 1 on: always from the snapshot's state, each with other noise."""
    rate, before = episode.controls.planner.rate, number - 1
    knots = snapshot.knots, snapshot.horizon, snapshot.spline
    previous = Plan(before, anchor_tick(before, rate), *knots)
    tick = anchor_tick(number, rate)
    return episode.request(number, tick, snapshot.state, snapshot.memory, previous)


@contextmanager
def in_process(episode: Episode, threads: int) -> Iterator[MakePlan]:
    """Yield what makes plans of an episode with rollouts in this process."""
    with LocalPlanning(episode.problem, episode.config, threads) as planning:
        yield lambda request: planning(request, episode.controls.planner)
