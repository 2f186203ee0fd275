"""One episode in one process, without Zenoh."""

import time
from collections.abc import Callable

from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Nobody, Operator
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End, Ending, fault
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.episode.lockstep import MakePlan, run_lockstep
from sumo_dist.episode.safety import sit_down
from sumo_dist.errors import Interrupted, SumoError, UsageError
from sumo_dist.estimate import make_estimator
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.tasks.task import Task

OnPlan = Callable[[PlanReport], None]


def run_single(
    config: EpisodeConfig,
    threads: int,
    on_plan: OnPlan = lambda _report: None,
    operator: Operator | None = None,
    task: Task | None = None,
) -> tuple[Recording, Ending]:
    """Run an episode to its end; Ctrl-C ends it early and keeps what was recorded.

    Args:
        config: what decides it.
        threads: of the rollouts.
        on_plan: is told of every plan.
        operator: gives commands.
        task: takes the place of the one that the config names.
    """
    if config.clock != "lockstep":
        raise UsageError("the realtime clock plans asynchronously: it needs at least one worker")
    episode = Episode.assemble(config, task=task)
    with LocalPlanning(episode.problem, config, threads) as planning:
        make_plan = recorded(planning, episode.recording, on_plan)
        return episode.recording, run_planned(episode, make_plan, operator or Nobody())


def recorded(planning: LocalPlanning, recording: Recording, on_plan: OnPlan) -> MakePlan:
    """Return what plans, and records what only the planning process knows of a plan."""

    def make_plan(request: PlanRequest, planner: PlannerConfig) -> PlanReport:
        report = planning(request, planner)
        recording.add_traces(planning.traces)
        recording.plan_cpu_ms.append(planning.cpu_ms)
        on_plan(report)
        return report

    return make_plan


def run_planned(episode: Episode, make_plan: MakePlan, operator: Operator) -> Ending:
    """Run an episode whose plans may come from anywhere, and write it into its recording."""
    estimate = make_estimator(episode.config.estimator, episode.problem.model)
    began = time.perf_counter()
    try:
        ending = run_lockstep(episode, estimate, make_plan, operator)
        if ending.kind is End.STOPPED:
            ending = sit_down(episode, ending)
    except (KeyboardInterrupt, Interrupted):
        ending = Ending(End.INTERRUPTED)
        episode.recording.drop_unfinished()
    except SumoError as error:
        ending = fault(error)
    return episode.finish(ending, began)
