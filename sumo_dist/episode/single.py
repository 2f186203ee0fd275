"""One episode in one process, without Zenoh."""

import time
from collections.abc import Callable

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.episode.lockstep import run_lockstep
from sumo_dist.episode.plant import Plant
from sumo_dist.episode.referee import Referee
from sumo_dist.episode.start import draw_start
from sumo_dist.episode.summary import Ending
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
    plant = Plant(task.scene, draw_start(task, config.seed), config.estimator)
    controller = make_controller(problem.policy, plant.model, config.engine)
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

        began = time.perf_counter()
        try:
            reason = run_lockstep(
                plant,
                controller,
                task.actions,
                Referee(task, plant.model, config.time_limit),
                make_estimator(config.estimator, plant.model),
                make_plan,
                recording,
            )
        except KeyboardInterrupt:
            reason = "interrupted"
        except SumoError as error:
            reason = f"fault: {error}"
        return recording, Ending(reason, time.perf_counter() - began)
