"""Latency compensation: plan from where the robot will be when the plan arrives."""

import numpy as np

from sumo_dist.planner.plan import Plan
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.rollout.interface import Engine


def roll_forward(
    engine: Engine,
    actions: ActionSpace,
    plan: Plan,
    tick: int,
    until: int,
    state: np.ndarray,
    memory: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Predict state and policy memory at tick `until` under the plan that is being followed.

    A prediction that diverges is no better than none: the state is then returned as it came.
    """
    if until <= tick:
        return state, memory
    commands = actions.commands(plan.at(np.arange(tick, until)))
    ahead = engine.rollout(state, memory, commands[None])
    if not ahead.valid[0]:
        return state, memory
    return ahead.states[0, -1], ahead.memory[0]
