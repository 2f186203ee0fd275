"""The synchronous episode: the robot waits for the plan of its state (paper's analysis).

The same loop runs in one process and over Zenoh; only `estimate` and `make_plan` differ. It reads
no clock, so a seed decides every bit of it.
"""

from collections.abc import Callable

import numpy as np

from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Operator
from sumo_dist.episode.ending import Ending
from sumo_dist.errors import Stopped, SumoError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import plan_due

Estimate = Callable[[Readings], np.ndarray]
"""Readings up to a tick -> the state (nq + nv,) that policy and planner act on."""

MakePlan = Callable[[PlanRequest, PlannerConfig], PlanReport]


def run_lockstep(
    episode: Episode, estimate: Estimate, make_plan: MakePlan, operator: Operator
) -> Ending:
    """Run one episode to its end.

    Raises:
        SumoError: the policy's joint targets are not finite, or the body is at its end.
    """
    body, controls = episode.body, episode.controls
    memory = episode.controller.initial_memory()
    plan: Plan | None = None
    while True:
        try:
            state = estimate(body.read())
        except Stopped:  # the stop itself is the first of the commands that wait
            state = None
        episode.note_tick(state, memory)
        if state is not None and (verdict := episode.verdict(body.tick, state)) is not None:
            return verdict
        if (end := controls.operate(operator, body.tick)) is not None:
            return end
        assert state is not None, "a stop ends the episode"
        number = plan_due(body.tick, controls.planner.rate)
        if number is not None:
            request = episode.request(number, body.tick, state, memory, plan)
            try:
                report = make_plan(request, controls.planner)
            except Stopped:
                end = controls.operate(operator, body.tick)
                assert end is not None, "the stop waits among the commands"
                return end
            episode.recording.add_plan(report)
            plan = report.plan
        assert plan is not None, "tick 0 always asks for plan 0"
        targets, memory = episode.follow(plan.at(np.array([body.tick]))[0], state, memory)
        if not episode.guard.send(targets):
            raise SumoError(f"the policy's joint targets are not finite at tick {body.tick}")
        body.advance()
