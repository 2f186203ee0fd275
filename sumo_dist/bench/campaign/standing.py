"""The control: the robot stands and nobody plans, so whatever succeeds did so by itself."""

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import Ending
from sumo_dist.episode.single import run_planned
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.rollout import engine_identity
from sumo_dist.tasks import load_task


def run_standing(config: EpisodeConfig) -> tuple[Recording, Ending]:
    """Run an episode from the same start in which every plan is to stand and wait."""
    problem = Problem.build(load_task(config.task), planning_options(config.planner))
    actions = problem.task.actions
    knots = actions.unit(actions.default)[None].astype(np.float32)  # (1, n)

    def stand(request: PlanRequest) -> PlanReport:
        plan = Plan(request.number, request.tick, knots, config.planner.horizon, "zero")
        nothing = np.zeros(0)
        return PlanReport(plan, nothing, nothing.astype(bool), nothing, plan_ms=0.0, own_ms=0.0)

    engine, _ = engine_identity(config.engine)
    recording = Recording({**config.describe(problem, engine), "optimizer": "stand"})
    return recording, run_planned(config, problem, stand, recording)
