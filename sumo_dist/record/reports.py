"""The plans of a recording with their account, as whoever made them told it."""

from collections.abc import Iterator

import numpy as np

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording


def reports(recording: Recording) -> Iterator[PlanReport]:
    """Yield the account of each recorded plan, as far as a recording has it."""
    for i, planner in enumerate(planners(recording)):
        yield report(recording, i, planner)


def report(recording: Recording, i: int, planner: PlannerConfig) -> PlanReport:
    """Return the account of the i-th recorded plan, which was made with some settings.

    Of a plan of more candidates than an episode has at first, the rest count as not finite: their
    costs are not in a recording.
    """
    kept = recording.costs[i]
    costs = np.full(int(recording.rollouts[i]), np.inf)
    costs[: len(kept)] = kept[: len(costs)]
    finite = np.isfinite(costs)
    plan = Plan(
        *(int(recording.plan_numbers[i]), int(recording.plan_ticks[i])),
        recording.knots[i],
        planner.horizon,
        planner.spline,
    )
    return PlanReport(
        plan=plan,
        costs=np.where(finite, costs, 0.0),
        finite=finite,
        terms=recording.terms[i],
        weights=recording.weights[i],
        parameters=recording.parameters[i],
        plan_ms=float(recording.plan_ms[i]),
        own_ms=0.0,
        age_ticks=int(recording.age_ticks[i]),
        lost=int(recording.lost[i]),
        reissued=int(recording.reissued[i]),
        failed=not finite.any(),
    )


def planners(recording: Recording) -> Iterator[PlannerConfig]:
    """Yield the settings that each recorded plan was made with: an operator may change them."""
    for tick in recording.plan_ticks:
        yield planner_at(recording, int(tick))


def planner_at(recording: Recording, tick: int) -> PlannerConfig:
    """Return the settings by which an operator has plans made at a tick."""
    planner = PlannerConfig.from_settings(recording.config["episode"]["planner"])
    return planner.with_settings(
        f"{said['name']}={said['value']}"
        for said in recording.operator
        if said["verb"] == "planner" and said["tick"] <= tick
    )
