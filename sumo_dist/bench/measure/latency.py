"""`sumo-dist bench latency`: what late plans cost, and how much of it compensation gives back.

Deterministic: a plan is made from the state of its tick and reaches the robot a fixed number of
planning periods later. No clock is read, so a row can be repeated to the last bit anywhere.
"""

import json
import sys
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sumo_dist.bench.campaign.processes import Processes, run_each
from sumo_dist.bench.engine import checked_engine
from sumo_dist.bench.layout import heading, markdown
from sumo_dist.bench.results.stats import wilson
from sumo_dist.episode.assemble import make_guard, make_plant
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.follow import Follower
from sumo_dist.episode.lockstep import act
from sumo_dist.episode.referee import Referee
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.estimate import make_estimator
from sumo_dist.planner.compensate import roll_forward
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.provenance import cores, timing_provenance
from sumo_dist.rollout import make_controller
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK, anchor_tick, plan_due

PERIOD_MS = 50  # between plans, on average
PERIODS = (0, 1, 2, 4)  # plans are this many periods late


@dataclass(frozen=True)
class Options:
    """Options of `bench latency`.

    Attributes:
        json: print one JSON object.
        task: what is done.
        trials: seeds of each row.
        seed0: the first seed.
        plant: nominal, perturbed or hard.
        time_limit: robot time per trial [s]; the task's own by default.
        jobs: trials at a time; by default one for each core.
    """

    json: bool = False
    task: str = "spot/move_box"
    trials: int = 5
    seed0: int = 1
    plant: str = "nominal"
    time_limit: float | None = None
    jobs: int | None = None

    def __post_init__(self) -> None:
        if min(self.trials, 1 if self.jobs is None else self.jobs) < 1:
            raise UsageError("trials and jobs must be at least 1")


@dataclass(frozen=True)
class Trial:
    """One episode with late plans.

    Attributes:
        episode: what is done.
        periods: planning periods from a state to its plan's arrival.
        compensate: plans are made for the instant of their arrival.
    """

    episode: EpisodeConfig
    periods: int
    compensate: bool


def main(options: Options) -> int:
    """Run all trials and print a table or one JSON object."""
    engine, _ = checked_engine("auto")
    about = timing_provenance()
    trials = [
        Trial(
            EpisodeConfig(options.task, seed, time_limit=options.time_limit, plant=options.plant),
            periods,
            compensate,
        )
        for seed in range(options.seed0, options.seed0 + options.trials)
        for periods in PERIODS
        for compensate in ((False, True) if periods else (False,))
    ]
    found = []
    with Processes(run, options.jobs or cores()) as pool:
        for number, (trial, end) in enumerate(run_each(trials, [pool]), 1):
            if end is None:
                raise SumoError("the process of a trial died (out of memory?)")
            found.append((trial, *end))
            told = f"[{number}/{len(trials)}] {trial.periods * PERIOD_MS} ms, "
            told += f"{'with' if trial.compensate else 'without'} compensation: {end[0]}"
            print(told, file=sys.stderr, flush=True)
    result = {
        **about,
        "engine": engine,
        "task": options.task,
        "plant": options.plant,
        "trials": options.trials,
        "seed0": options.seed0,
        "rows": rows(found),
    }
    print(json.dumps(result, indent=1) if options.json else text(result))
    return 0


def run(trial: Trial) -> tuple[str, float]:
    """Run one trial; return how it ended and its robot time [s]."""
    config = trial.episode
    task = load_task(config.task)
    problem = Problem.build(task, planning_options(config.planner))
    plant = make_plant(config, task)
    guard, referee = make_guard(task, plant), Referee(task, plant.model, config.time_limit)
    controller = make_controller(problem.policy, plant.model, config.engine)
    estimate = make_estimator(config.estimator, plant.model)
    memory, nq = controller.initial_memory(), plant.model.nq
    with problem.engine(1, config.engine) as engine:
        late = LatePlanner(trial, problem, Evaluator(problem, engine, config.planner), engine)
        while True:
            state = estimate(plant.read())
            if (verdict := referee.verdict(plant.tick, plant.state)) is not None:
                return verdict, plant.tick * TICK
            plan = late.follow(plant.tick, state, memory)
            targets, memory = act(controller, task.actions, plan, plant.tick, state, memory, nq)
            guard.send(targets)


class LatePlanner:
    """Makes plans that arrive late, each from the plan that will be followed by then."""

    def __init__(self, trial: Trial, problem: Problem, evaluator: Evaluator, engine: Any) -> None:
        """Start with nothing on its way."""
        self._trial, self._actions, self._engine = trial, problem.task.actions, engine
        self._planner = Planner(trial.episode.planner, self._actions, trial.episode.seed)
        self._evaluate = lambda request, _iteration, knots: evaluator(
            request.state, request.memory, knots
        )
        self._way: deque[tuple[int, Plan]] = deque()  # tick of arrival, plan
        self._follower = Follower(self._actions)
        self._newest: Plan | None = None

    def follow(self, tick: int, state: np.ndarray, memory: np.ndarray) -> Plan:
        """Make the plan that is due and return the one to follow, as a plan of one knot."""
        number = plan_due(tick)
        if number is not None:
            self._make(number, tick, state, memory)
        while self._way and self._way[0][0] <= tick:
            self._follower.offer(self._way.popleft()[1])
        action = self._follower.action(tick).astype(np.float32)
        return Plan(0, tick, action[None], 1.0, "zero")

    def _make(self, number: int, tick: int, state: np.ndarray, memory: np.ndarray) -> None:
        """Plan from this state; with compensation, from where its arrival will find the robot."""
        arrival = anchor_tick(number + self._trial.periods)
        if self._trial.compensate:
            state, memory = self._forward(tick, arrival, state, memory)
            number, tick = number + self._trial.periods, arrival
        request = PlanRequest(number, tick, state, memory, self._newest)
        self._newest = self._planner.plan(request, self._evaluate).plan
        self._way.append((arrival, self._newest))

    def _forward(
        self, tick: int, until: int, state: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Roll on under what will be followed: the plans that arrive one after the other."""
        stand = Plan(0, 0, self._actions.unit(self._actions.default)[None], 1.0, "zero")
        plans = [self._follower.plan or stand, *(plan for _, plan in self._way)]
        ends = [max(tick, plan.tick) for plan in plans[1:]] + [until]
        for plan, end in zip(plans, ends, strict=True):
            state, memory = roll_forward(
                self._engine, self._actions, plan, tick, end, state, memory
            )
            tick = max(tick, end)
        return state, memory


def rows(found: Sequence[tuple[Trial, str, float]]) -> list[dict[str, Any]]:
    """Count the successes of each delay, with and without compensation."""
    kinds = dict.fromkeys((trial.periods, trial.compensate) for trial, _, _ in found)
    counted = []
    for periods, compensate in sorted(kinds):
        ends = [
            (end, seconds)
            for trial, end, seconds in found
            if (trial.periods, trial.compensate) == (periods, compensate)
        ]
        times = [seconds for end, seconds in ends if end == "success"]
        counted.append(
            {
                "delay_ms": periods * PERIOD_MS,
                "compensation": compensate,
                "trials": len(ends),
                "successes": len(times),
                "median_s": round(float(np.median(times)), 2) if times else None,
                "ended_by": sorted({end for end, _ in ends if end != "success"}),
            }
        )
    return counted


def text(result: dict[str, Any]) -> str:
    """Lay out what was counted."""
    lines = []
    for row in result["rows"]:
        low, high = wilson(row["successes"], row["trials"])
        lines.append(
            (
                f"{row['delay_ms']}",
                "with" if row["compensation"] else "without" if row["delay_ms"] else "-",
                f"{row['successes']}/{row['trials']}",
                f"{low:.2f} to {high:.2f}",
                f"{row['median_s']:.1f}" if row["median_s"] is not None else "-",
                ", ".join(row["ended_by"]) or "-",
            )
        )
    heads = ("delay [ms]", "compensation", "solved", "Wilson 95 %", "median [s]", "else")
    last = result["seed0"] + result["trials"] - 1
    return "\n\n".join(
        (
            heading("bench latency", result),
            f"{result['task']} on the {result['plant']} plant, seeds {result['seed0']} to {last}, "
            f"default settings, {result['engine']}. Every plan reaches the robot a whole number of "
            "planning periods (40 and 60 ms in turn) after the state it was made from; with "
            "compensation it was made for the instant of its arrival. Median completion time of "
            "those solved.",
            markdown(heads, lines),
        )
    )
