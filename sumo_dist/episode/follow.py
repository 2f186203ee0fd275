"""What the robot does with the plans it gets, and when none comes."""

from collections import deque

import numpy as np

from sumo_dist.planner.plan import Plan
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.timing import TICK, anchor_tick

AHEAD_S = 2.0  # no plan is made for a time further off than this [s]
STAND_RAMP_S = 0.5  # from the last action of a plan that ran out to standing still


def misfit(plan: Plan, actions: ActionSpace, now: int | None = None) -> str:
    """Say why a plan cannot be followed by a robot with these actions, "" if it can.

    Its numbers are finite: what is not does not pass the wire.

    Args:
        plan: that came from outside.
        actions: the robot's.
        now: the tick it is; a plan from far ahead would keep out all that come before it.
    """
    if now is not None and (ahead := (plan.tick - now) * TICK) > AHEAD_S:
        return f"it begins {ahead:.0f} s from now, at most {AHEAD_S:g}"
    width = plan.knots.shape[-1] if plan.knots.ndim == 2 else 0
    if width != actions.size:
        return f"its knots have {width} numbers, this robot's actions {actions.size}"
    if (most := float(np.abs(plan.knots).max())) > 1.0:
        return f"an action of {most:g}, they lie in [-1, 1]"
    if plan.number > 0 and plan.tick not in (0, anchor_tick(plan.number)):
        return f"it is anchored on tick {plan.tick} instead of {anchor_tick(plan.number)}"
    return ""


class Follower:
    """Follows the newest plan that is due; at its end, ramps to standing and waits for the next."""

    def __init__(self, actions: ActionSpace) -> None:
        """Start with no plan: stand."""
        self._stand = actions.unit(actions.default)
        self._ahead: deque[Plan] = deque()  # plans that are not due yet, oldest first
        self.plan: Plan | None = None

    def offer(self, plan: Plan) -> None:
        """Take a plan unless a newer one is here; it is followed from its anchor tick on."""
        newest = self._ahead[-1] if self._ahead else self.plan
        if newest is None or plan.number > newest.number:
            self._ahead.append(plan)

    def action(self, tick: int) -> np.ndarray:
        """Normalised action (n,) at a tick."""
        while self._ahead and (self.plan is None or self._ahead[0].tick <= tick):
            self.plan = self._ahead.popleft()
        if self.plan is None:
            return self._stand
        over = (tick - self.plan.tick) * TICK - self.plan.horizon
        share = float(np.clip(over / STAND_RAMP_S, 0.0, 1.0))
        return (1.0 - share) * self.plan.at(np.array([tick]))[0] + share * self._stand

    def exhausted(self, tick: int) -> bool:
        """Whether the plan has run out."""
        return self.plan is not None and (tick - self.plan.tick) * TICK > self.plan.horizon
