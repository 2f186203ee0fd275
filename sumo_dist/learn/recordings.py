"""What recorded runs teach: where the robot was, and what the planner then did."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.errors import UsageError
from sumo_dist.math.splines import knot_times
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.learned import Contract
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.record.folders import RECORDING
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

FORESIGHT = 4.0  # of values [s]: some horizons, and less than most runs take


@dataclass(frozen=True)
class Examples:
    """Plans of some runs.

    Attributes:
        observations: (N, size) float32, of the states that the plans began with.
        knots: (N, F, n) float32, what was then done, at the times of a plan's knots.
        to_come: (N,) float32, the cost that was to come, see `cost_to_come`.
        runs: (N,) number of the run that each is of.
        contract: what inputs and knots are; all runs agree in it.
        tasks: names of the runs' tasks, and how many runs each has.
    """

    observations: np.ndarray
    knots: np.ndarray
    to_come: np.ndarray
    runs: np.ndarray
    contract: Contract
    tasks: dict[str, int]


def find_recordings(paths: Iterable[Path]) -> list[Path]:
    """Return the recordings among some files and in some folders, in order.

    Raises:
        UsageError: one of them has none.
    """
    found: list[Path] = []
    for path in paths:
        here = [path] if path.is_file() else sorted(path.rglob(RECORDING))
        if not here:
            raise UsageError(f"no recording in {path}; `sumo-dist run` writes one as DIR/run.npz")
        found += here
    return found


def gather(paths: Iterable[Path]) -> Examples:
    """Read the plans of all runs that ended in success.

    Raises:
        UsageError: a file is no recording, no run succeeded, or two runs would need different
            policies: other inputs, actions or times of knots.
    """
    problems: dict[str, Problem] = {}
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    tasks: dict[str, int] = {}
    contract: Contract | None = None
    for path in find_recordings(paths):
        recording = Recording.load(path)
        if recording.ending != End.SUCCESS or not len(recording.plan_ticks):
            continue
        config = EpisodeConfig.of(recording.config["episode"])
        if config.task not in problems:
            options = planning_options(config.planner)
            problems[config.task] = Problem.build(load_task(config.task), options)
        problem, planner = problems[config.task], config.planner
        times = knot_times(planner.spline, planner.nodes, planner.horizon)
        own = Contract.of(problem, tuple(times[times >= 0.0].tolist()), planner.rate, {})
        if contract is not None and (name := contract.differing(own)):
            raise UsageError(
                f"{path}: its policy would differ from that of {', '.join(tasks)}, in "
                f"{name.replace('_', ' ')}: {getattr(own, name)}, not {getattr(contract, name)}"
            )
        contract = own
        parts.append(_plans(recording, problem, planner, own))
        tasks[problem.task.name] = tasks.get(problem.task.name, 0) + 1
    if contract is None:
        raise UsageError("none of these runs ended in success: there is nothing to learn from")
    observations, knots, costs = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    runs = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    return Examples(observations, knots, costs, runs, contract, tasks)


def cost_to_come(costs: np.ndarray, horizon: float, rate: int) -> np.ndarray:
    """Return the mean cost from each plan on, what comes sooner counting more, (P,).

    A plan's cost is a mean over its horizon, so from horizon to horizon they make up that of the
    way as it was planned. The weight falls by e in `FORESIGHT`, and after a success nothing costs.

    Args:
        costs: (P,) of the best candidate of each plan of a run that succeeded.
        horizon: of the plans [s].
        rate: plans per second of robot time [Hz].
    """
    apart, kept = max(1, round(horizon * rate)), math.exp(-horizon / FORESIGHT)
    to_come = np.zeros(len(costs) + apart)
    for plan in reversed(range(len(costs))):
        to_come[plan] = (1.0 - kept) * costs[plan] + kept * to_come[plan + apart]
    return to_come[: len(costs)].astype(np.float32)


def carried_out(ticks: np.ndarray, now: np.ndarray, times: Sequence[float]) -> np.ndarray:
    """Return what was done at some times after each plan's start, (P, F, n) float32.

    A plan's own later knots say little: the planner searches for them anew before they come, and
    the last hardly change its cost. After the last plan its action stays.

    Args:
        ticks: (P,) on which plans begin.
        now: (P, n) their actions there.
        times: (F,) after a plan's start [s].
    """
    due = ticks[:, None] + np.round(np.asarray(times) / TICK).astype(int)
    return now[np.searchsorted(ticks, due, side="right") - 1].astype(np.float32)


def _plans(
    recording: Recording, problem: Problem, planner: PlannerConfig, contract: Contract
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Observations (P, size), knots (P, F, n) and cost to come (P,) of a run's plans."""
    ticks = np.asarray(recording.plan_ticks)
    least = np.asarray(recording.costs).min(axis=1)  # infinite where all candidates were lost
    known = (ticks < len(recording.estimates)) & np.isfinite(least)  # the last tick may lack
    states = np.asarray(recording.estimates)[ticks[known]]
    observer = Observer(problem.task, problem.model)
    sets, which = np.unique(np.asarray(recording.parameters)[known], axis=0, return_inverse=True)
    observations = np.empty((len(states), observer.size), np.float32)
    for number, parameters in enumerate(sets):
        rows = which.reshape(-1) == number
        observations[rows] = observer(states[rows], problem.task.table.named(parameters))
    now = np.asarray(recording.knots)[known][:, -len(contract.times)]
    knots = carried_out(ticks[known], now, contract.times)
    return observations, knots, cost_to_come(least[known], planner.horizon, planner.rate)
