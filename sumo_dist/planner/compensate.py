"""Latency compensation: plan from where the robot will be when the plan arrives."""

from collections.abc import Sequence

import numpy as np

from sumo_dist.planner.plan import Plan
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.rollout.interface import Engine


def roll_forward(
    engine: Engine,
    actions: ActionSpace,
    plans: Sequence[Plan],
    tick: int,
    until: int,
    state: np.ndarray,
    memory: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Predict state and policy memory at tick `until` under the plans that are followed until then.

    A prediction that diverges is no better than none: the state is then returned as it came.

    Args:
        engine: with the model to roll out.
        actions: of the robot.
        plans: at least one, oldest first: each is followed from its anchor on, the first one before
            that, too.
        tick, until: from when to when.
        state, memory: (nq + nv,) and (nm,) at `tick`.
    """
    if until <= tick:
        return state, memory
    ends = [max(tick, min(until, plan.tick)) for plan in plans[1:]] + [until]
    followed = []
    for plan, end in zip(plans, ends, strict=True):
        followed.append(plan.at(np.arange(tick, end)))
        tick = max(tick, end)
    commands = actions.commands(np.concatenate(followed))
    ahead = engine.rollout(state, memory, commands[None])
    if not ahead.valid[0]:
        return state, memory
    return ahead.states[0, -1], ahead.memory[0]
