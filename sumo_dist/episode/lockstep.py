"""The synchronous episode: the plant waits for the plan of its state (paper's analysis).

The same loop runs in one process and over Zenoh; only `estimate` and `make_plan` differ. It reads
no clock, so a seed decides every bit of it.
"""

from collections.abc import Callable

import numpy as np

from sumo_dist.episode.referee import Referee
from sumo_dist.errors import SumoError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.plant.simulated import Plant
from sumo_dist.record.recording import Recording
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.rollout.interface import Controller
from sumo_dist.timing import plan_due

Estimate = Callable[[Readings], np.ndarray]
"""Readings up to a tick -> the state (nq + nv,) that policy and planner act on."""

MakePlan = Callable[[PlanRequest], PlanReport]


def run_lockstep(
    plant: Plant,
    guard: CommandGuard,
    controller: Controller,
    actions: ActionSpace,
    referee: Referee,
    estimate: Estimate,
    make_plan: MakePlan,
    recording: Recording,
) -> str:
    """Run one episode to its end and return the referee's verdict; commands go by the guard.

    Raises:
        SumoError: the policy's joint targets are not finite.
    """
    memory = controller.initial_memory()
    plan: Plan | None = None
    while True:
        state = estimate(plant.read())
        recording.add_tick(plant.state, state, memory)
        verdict = referee.verdict(plant.tick, plant.state)
        if verdict is not None:
            return verdict
        number = plan_due(plant.tick)
        if number is not None:
            report = make_plan(PlanRequest(number, plant.tick, state, memory, plan))
            recording.add_plan(report)
            plan = report.plan
        assert plan is not None, "tick 0 always asks for plan 0"
        targets, memory = act(controller, actions, plan, plant.tick, state, memory, plant.model.nq)
        if not guard.send(targets):
            raise SumoError(f"the policy's joint targets are not finite at tick {plant.tick - 1}")


def act(
    controller: Controller,
    actions: ActionSpace,
    plan: Plan,
    tick: int,
    state: np.ndarray,
    memory: np.ndarray,
    nq: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Follow a plan for one tick: joint targets (nu,) [rad] and the policy's next memory (nm,)."""
    command = actions.commands(plan.at(np.array([tick])))[0]
    return controller.step(state[:nq], state[nq:], command, memory)
