"""What the robot does with the plans it gets, and when none comes."""

from collections import deque

import numpy as np

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK, anchor_tick

AHEAD_S = 2.0  # no plan is made for a time further off than this [s]
STAND_RAMP_S = 0.5  # from the last action of a plan that ran out to standing still


def misfit(report: PlanReport, task: Task, planner: PlannerConfig, now: int) -> str:
    """Say why a plan, or its account, cannot be a robot's, "" if it can.

    Its numbers are finite: what is not does not pass the wire.

    Args:
        report: that came from outside.
        task: the robot's.
        planner: the settings that plans are asked for with; nodes and rate stay as they are.
        now: the tick it is; a plan from far ahead would keep out all that come before it.
    """
    sizes = len(report.terms), len(report.weights), len(report.parameters)
    defaults = task.table.defaults
    wanted = len(task.cost), len(task.cost), len(defaults.parameters)
    if sizes != wanted:
        return f"it has {sizes} terms, weights and parameters, the robot's task has {wanted}"
    if report.plan.knots.ndim == 2 and len(report.plan.knots) != planner.nodes:
        return f"it has {len(report.plan.knots)} nodes, {planner.nodes} were asked for"
    return unfollowable(report.plan, task.actions, planner.rate, now)


def unfollowable(plan: Plan, actions: ActionSpace, rate: int, now: int | None = None) -> str:
    """Say why a robot with these actions cannot follow a plan, "" if it can; see `misfit`.

    Args:
        plan: that came from outside.
        actions: of the robot.
        rate: plans per second of robot time that are asked for.
        now: the tick it is; None where no plan is too far ahead.
    """
    if now is not None and (ahead := (plan.tick - now) * TICK) > AHEAD_S:
        return f"it begins {ahead:.0f} s from now, at most {AHEAD_S:g}"
    width = plan.knots.shape[-1] if plan.knots.ndim == 2 else 0
    if width != actions.size:
        return f"its knots have {width} numbers, this robot's actions {actions.size}"
    if (most := float(np.abs(plan.knots).max())) > 1.0:
        return f"an action of {most:g}, they lie in [-1, 1]"
    anchor = anchor_tick(plan.number, rate)
    if plan.number > 0 and plan.tick not in (0, anchor):
        return f"it is anchored on tick {plan.tick} instead of {anchor}"
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
