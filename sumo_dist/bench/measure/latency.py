"""`sumo-dist bench latency`: what late plans cost, and how much of it compensation gives back.

Deterministic: a plan is made from the state of its tick and reaches the robot a fixed number of
planning periods later. No clock is read, so a row can be repeated to the last bit anywhere.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sumo_dist.bench.campaign.processes import processes
from sumo_dist.bench.layout import Result, SeedOptions, check_at_least, markdown, run_bench
from sumo_dist.bench.results.stats import wilson
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.follow import Follower
from sumo_dist.errors import SumoError
from sumo_dist.estimate import make_estimator
from sumo_dist.planner.compensate import roll_forward
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.guidance import make_guide
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import Planner
from sumo_dist.provenance import cores
from sumo_dist.rollout.interface import Engine
from sumo_dist.tasks import load_task
from sumo_dist.terminal import say
from sumo_dist.timing import TICK, anchor_tick, plan_due

# Planning periods by which plans are late, and whether they are made for their arrival.
KINDS = ((0, False), *((periods, way) for periods in (1, 2, 4) for way in (False, True)))
HEAD = ("delay [ms]", "compensation", "solved", "Wilson 95 %", "median [s]", "else")


@dataclass(frozen=True)
class Options(SeedOptions):
    """Options of `bench latency`.

    Attributes:
        plant: nominal, perturbed or hard.
        time_limit: robot time per trial [s]; the task's own by default.
        jobs: trials at a time; by default one for each core.
    """

    plant: str = "nominal"
    time_limit: float | None = None
    jobs: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least(1, jobs=self.jobs)


@dataclass(frozen=True)
class DelayedTrial:
    """One episode with late plans."""

    episode: EpisodeConfig
    periods: int  # planning periods from a state to its plan's arrival
    compensate: bool  # plans are made for the instant of their arrival

    @property
    def delay_ms(self) -> int:
        """Robot time by which a plan is late, on average."""
        return round(self.periods * self.episode.planner.period * 1e3)

    def __str__(self) -> str:
        """Name its row."""
        compensation = "with" if self.compensate else "without"
        return f"{self.delay_ms} ms, {compensation} compensation"


def main(options: Options) -> int:
    """Run all trials and print a table or one JSON object."""
    run_bench("bench latency", options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Run every delay with every seed, in processes of their own."""
    about = {**options.about(), "plant": options.plant}
    planner = PlannerConfig.resolve(load_task(options.task).planner)
    episode = EpisodeConfig(
        options.task, planner=planner, time_limit=options.time_limit, plant=options.plant
    )
    trials = [
        DelayedTrial(replace(episode, seed=seed), *kind) for seed in options.seeds for kind in KINDS
    ]
    ends = []
    with processes(run, options.jobs or cores()) as runners:
        for number, (trial, end) in enumerate(runners.run_each(trials), 1):
            if end is None:
                raise SumoError("the process of a trial died (out of memory?)")
            ends.append((trial, *end))
            say(f"[{number}/{len(trials)}] {trial}: {end[0]}")
    return {**about, "rows": rows(ends)}


def run(trial: DelayedTrial) -> tuple[str, float]:
    """Run one trial; return how it ended and its robot time [s]."""
    episode = Episode.assemble(trial.episode)
    body, problem = episode.body, episode.problem
    estimate = make_estimator(trial.episode.estimator, problem.model)
    memory = episode.controller.initial_memory()
    with problem.engine(1, trial.episode.engine) as engine:
        planner = LatePlanner(trial, episode, engine)
        while True:
            state = estimate(body.read())
            if (ending := episode.verdict(body.tick, state)) is not None:
                return ending.reason, body.tick * TICK
            action = planner.action(body.tick, state, memory)
            targets, memory = episode.follow(action, state, memory)
            episode.guard.send(targets)
            body.advance()


class LatePlanner:
    """Makes plans that arrive late, each from the plan that will be followed by then."""

    def __init__(self, trial: DelayedTrial, episode: Episode, engine: Engine) -> None:
        """Start with no plan under way."""
        self._trial, self._episode, self._engine = trial, episode, engine
        self._actions, self._rate = episode.task.actions, trial.episode.planner.rate
        guide = make_guide(episode.problem, trial.episode.planner)
        self._planner = Planner(trial.episode.planner, self._actions, trial.episode.seed, guide)
        evaluator = Evaluator(episode.problem, engine, trial.episode.planner)
        self._evaluate = lambda request, _iteration, knots: evaluator(
            request.state, request.memory, request.cost.parameters, knots
        )
        self._under_way: deque[tuple[int, Plan]] = deque()  # tick of arrival, plan
        self._follower = Follower(self._actions)
        self._newest: Plan | None = None

    def action(self, tick: int, state: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Make the plan that is due; return the normalised action (n,) of those that are here."""
        number = plan_due(tick, self._rate)
        if number is not None:
            self._make(number, tick, state, memory)
        while self._under_way and self._under_way[0][0] <= tick:
            self._follower.offer(self._under_way.popleft()[1])
        return self._follower.action(tick)

    def _make(self, number: int, tick: int, state: np.ndarray, memory: np.ndarray) -> None:
        """Plan from this state; with compensation, from where its arrival will find the robot."""
        arrival = anchor_tick(number + self._trial.periods, self._rate)
        if self._trial.compensate:
            state, memory = self._forward(tick, arrival, state, memory)
            number, tick = number + self._trial.periods, arrival
        request = self._episode.request(number, tick, state, memory, self._newest)
        self._newest = self._planner.plan(request, self._evaluate).plan
        self._under_way.append((arrival, self._newest))

    def _forward(
        self, tick: int, until: int, state: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Roll on under what will be followed: the plans that arrive one after the other."""
        stand = Plan(0, 0, self._actions.unit(self._actions.default)[None], 1.0, "zero")
        plans = [self._follower.plan or stand, *(plan for _, plan in self._under_way)]
        ends = [max(tick, plan.tick) for plan in plans[1:]] + [until]
        for plan, end in zip(plans, ends, strict=True):
            state, memory = roll_forward(
                self._engine, self._actions, [plan], tick, end, state, memory
            )
            tick = max(tick, end)
        return state, memory


def rows(ends: Sequence[tuple[DelayedTrial, str, float]]) -> list[dict[str, Any]]:
    """Count the successes of each delay, with and without compensation."""
    kinds: dict[tuple[int, bool], list[tuple[str, float]]] = {}
    for trial, end, seconds in ends:
        kinds.setdefault((trial.delay_ms, trial.compensate), []).append((end, seconds))
    counted = []
    for (delay_ms, compensate), found in sorted(kinds.items()):
        times = [seconds for end, seconds in found if end == "success"]
        counted.append(
            {
                "delay_ms": delay_ms,
                "compensation": compensate,
                "trials": len(found),
                "successes": len(times),
                "median_s": round(float(np.median(times)), 2) if times else None,
                "ended_by": sorted({end for end, _ in found} - {"success"}),
            }
        )
    return counted


def text(result: Result) -> Iterable[str]:
    """Lay out what was counted."""
    last = result["seed0"] + result["trials"] - 1
    yield (
        f"{result['task']} on the {result['plant']} plant, seeds {result['seed0']} to {last}, "
        f"default settings, {result['engine']}. Every plan reaches the robot a whole number of "
        "planning periods after the state it was made from; with "
        "compensation it was made for the instant of its arrival. Median completion time of "
        "those solved."
    )
    yield markdown(HEAD, [_cells(row) for row in result["rows"]])


def _cells(row: Result) -> tuple[str, ...]:
    low, high = wilson(row["successes"], row["trials"])
    without = "without" if row["delay_ms"] else "-"
    return (
        f"{row['delay_ms']}",
        "with" if row["compensation"] else without,
        f"{row['successes']}/{row['trials']}",
        f"{low:.2f} to {high:.2f}",
        "-" if row["median_s"] is None else f"{row['median_s']:.1f}",
        ", ".join(row["ended_by"]) or "-",
    )
