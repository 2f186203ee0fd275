"""`sumo-dist bench model`: what each departure of the planning model saves, and what it changes.

Plans of a run are asked for again, of one model after the other: the same candidates from the same
states. What a model is worth is how it orders them, beside the plant's own model.
"""

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from sumo_dist.bench.layout import Result, check_at_least, checked_engine, run_bench, table
from sumo_dist.bench.measure.variant import timed
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.math import splines
from sumo_dist.model.departures import LEAN
from sumo_dist.model.scene import PLANT, ModelOptions
from sumo_dist.optim import noise_ramp
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation, Evaluator
from sumo_dist.planner.problem import Problem
from sumo_dist.tasks import load_task
from sumo_dist.terminal import say

ELITES = 3
FULL, PLANT_S, HALF = "full", "the plant's", "the plant's, half its step"

COLUMNS = {
    "model": "{model}",
    "CPU of a plan [ms]": "{cpu_ms:.1f}",
    "of full": "{ratio:.3f}",
    "best 3 shared with the plant's": "{shared:.2f}",
    "rank correlation": "{rank:.3f}",
    "shared with half its step": "{shared_half:.2f}",
    "rank correlation with it": "{rank_half:.3f}",
}


@dataclass(frozen=True)
class Options:
    """Options of `bench model`.

    Attributes:
        task: whose plans are asked for again.
        json: print one JSON object.
        seed: of the run that they are taken from, and of the candidates.
        seconds: that run's time limit [s].
        plans: how many, spread over the run.
        rollouts: candidates of each.
        repeats: timed rounds of all models.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
    """

    task: str = "spot/move_box"
    json: bool = False
    seed: int = 1
    seconds: float = 8.0
    plans: int = 16
    rollouts: int = 32
    repeats: int = 3
    engine: str = "auto"

    def __post_init__(self) -> None:
        check_at_least(0, seed=self.seed)
        check_at_least(1, plans=self.plans, repeats=self.repeats)
        check_at_least(ELITES, rollouts=self.rollouts)


class Question(NamedTuple):
    """What a plan is made of: a state, policy memory, parameters and candidates (B, K, n)."""

    state: np.ndarray
    memory: np.ndarray
    parameters: np.ndarray
    knots: np.ndarray


def main(options: Options) -> int:
    """Measure, and print a table or one JSON object."""
    command = f"bench model --task {options.task} --seed {options.seed}"
    run_bench(command, options.json, partial(measure, options), text)
    return 0


def measure(options: Options) -> Result:
    """Ask every model for the same plans, in turn."""
    name, build = checked_engine(options.engine)
    task = load_task(options.task)
    config = PlannerConfig.resolve(task.planner)
    models = planning_models(config)
    problems = {model: Problem.build(task, of_it) for model, of_it in models.items()}
    cpu = {model: [] for model in models}
    costs = {model: [] for model in models}
    weights = task.table.defaults.weights
    with ExitStack() as stack:
        ask = {
            model: Evaluator(
                problem, stack.enter_context(problem.engine(1, options.engine)), config
            )
            for model, problem in problems.items()
        }
        for number, question in enumerate(questions(options, config)):
            found = rounds(ask, question, options.repeats, number)
            for model, (least, evaluation) in found.items():
                cpu[model].append(least)
                costs[model].append(evaluation.costs(weights))
            say(f"{number + 1} of {options.plans} plans")
    return {
        "engine": name,
        "engine_build": build,
        "task": options.task,
        "plans": options.plans,
        "rollouts": options.rollouts,
        "rows": [
            {
                "model": model,
                "cpu_ms": float(np.median(cpu[model])),
                "ratio": float(np.median(np.divide(cpu[model], cpu[FULL]))),
                **agreement(costs[model], costs[PLANT_S], ""),
                **agreement(costs[model], costs[HALF], "_half"),
            }
            for model in models
        ],
    }


def planning_models(config: PlannerConfig) -> dict[str, ModelOptions]:
    """Return the models that are compared, by name."""

    def planning(*departures: str) -> ModelOptions:
        return ModelOptions(config.timestep, config.fluid_density, departures=departures)

    return {
        FULL: planning(),
        **{f"without {departure}": planning(departure) for departure in LEAN},
        "lean: without all of these": planning(*LEAN),
        PLANT_S: ModelOptions(PLANT.timestep, PLANT.fluid_density),
        HALF: ModelOptions(PLANT.timestep / 2, PLANT.fluid_density),
    }


def questions(options: Options, config: PlannerConfig) -> Iterable[Question]:
    """Yield plans of a run, with candidates around them; the noise is the paper's."""
    episode = EpisodeConfig(
        options.task, seed=options.seed, time_limit=options.seconds, planner=config
    )
    run, _ = run_single(episode, threads=1)
    rng = np.random.Generator(np.random.Philox(options.seed))
    given = splines.given(config.spline)
    for plan in np.linspace(0, len(run.plan_ticks) - 1, options.plans).round().astype(int):
        tick, knots = run.plan_ticks[plan], run.knots[plan]
        noise = rng.standard_normal((options.rollouts, *knots.shape))
        noise[0] = noise[:, :given] = 0.0
        noise[:, given:] *= noise_ramp(0.02, 0.6, len(knots) - given, knots.shape[1])
        candidates = np.clip(knots + noise, -1.0, 1.0).astype(np.float32)
        yield Question(run.estimates[tick], run.memories[tick], run.parameters[plan], candidates)


def rounds(
    ask: dict[str, Callable[..., Evaluation]], question: Question, repeats: int, first: int
) -> dict[str, tuple[float, Evaluation]]:
    """Least processor time [ms] and the answer of every model, each time another one first."""
    order, found = list(ask), {}
    for repeat in range(first, first + repeats):
        turn = repeat % len(order)
        for model in order[turn:] + order[:turn]:
            _, cpu_ms, evaluation = timed(partial(ask[model], *question))
            least = min(cpu_ms, found[model][0]) if model in found else cpu_ms
            found[model] = least, evaluation
    return found


def agreement(ours: list[np.ndarray], theirs: list[np.ndarray], suffix: str) -> dict[str, float]:
    """How far two models agree on which candidates are good, means over plans of costs (B,)."""
    shared, ranks = [], []
    for one, other in zip(ours, theirs, strict=True):
        best = (set(np.argsort(costs, kind="stable")[:ELITES]) for costs in (one, other))
        shared.append(len(set.intersection(*best)) / ELITES)
        both = np.isfinite(one) & np.isfinite(other)
        first, second = (np.argsort(np.argsort(costs[both])) for costs in (one, other))
        ranks.append(np.corrcoef(first, second)[0, 1] if both.sum() > 1 else np.nan)
    return {f"shared{suffix}": float(np.mean(shared)), f"rank{suffix}": float(np.nanmean(ranks))}


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"{result['plans']} plans of a run of {result['task']}, {result['rollouts']} candidates "
        f"each, asked of every model in turn; {result['engine']}, one thread."
    )
    yield table(COLUMNS, result["rows"])
