"""One episode in one process, without Zenoh."""

import time
from collections.abc import Callable

from sumo_dist.episode.assemble import make_guard, make_plant
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import Ending
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.episode.lockstep import MakePlan, run_lockstep
from sumo_dist.episode.referee import Referee
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.estimate import make_estimator
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.rollout import make_controller
from sumo_dist.tasks import load_task

OnPlan = Callable[[PlanReport], None]


def run_single(
    config: EpisodeConfig, threads: int, on_plan: OnPlan = lambda _report: None
) -> tuple[Recording, Ending]:
    """Run an episode to its end; Ctrl-C ends it early and keeps what was recorded."""
    if config.clock != "lockstep":
        raise UsageError("the realtime clock plans asynchronously: it needs at least one worker")
    task = load_task(config.task)
    problem = Problem.build(task, planning_options(config.planner))
    with problem.engine(threads, config.engine) as engine:
        recording = Recording(config.describe(problem, engine.name))
        planning = LocalPlanning(
            Planner(config.planner, task.actions, config.seed),
            Evaluator(problem, engine, config.planner),
        )

        def make_plan(request: PlanRequest) -> PlanReport:
            report = planning(request)
            recording.traces.append(planning.traces)
            on_plan(report)
            return report

        return recording, run_planned(config, problem, make_plan, recording)


def run_planned(
    config: EpisodeConfig, problem: Problem, make_plan: MakePlan, recording: Recording
) -> Ending:
    """Run an episode whose plans may come from anywhere, and write it into the recording."""
    task = problem.task
    plant = make_plant(config, task)
    guard = make_guard(task, plant, recording)
    controller = make_controller(problem.policy, plant.model, config.engine)
    referee = Referee(task, plant.model, config.time_limit)
    estimate = make_estimator(config.estimator, plant.model)
    began = time.perf_counter()
    try:
        reason = run_lockstep(
            plant, guard, controller, task.actions, referee, estimate, make_plan, recording
        )
    except KeyboardInterrupt:
        reason = "interrupted"
        recording.drop_unfinished()
    except SumoError as error:
        reason = f"fault: {error}"
    recording.commands = guard.account()
    return Ending(reason, time.perf_counter() - began)
