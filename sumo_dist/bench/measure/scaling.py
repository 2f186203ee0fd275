"""`sumo-dist bench scaling`: how long plans take on 1 to 256 workers, from measured parts.

The parts are measured on this machine, the plans of many hosts are predicted by `pool_model`, and
the prediction is compared with plans that are made here: by real workers, as many as there are
cores, and by scripted ones that take as long for a request as a slow worker would.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sumo_dist.bench.layout import Result, check_at_least, checked_engine, run_bench
from sumo_dist.bench.measure.pool_bench import Bench, Made
from sumo_dist.bench.measure.pool_model import (
    PERIOD_MS,
    Parts,
    Prediction,
    RolloutTimes,
    free_messages,
    most_that_fit,
    predict,
    predict_realtime,
    requests,
)
from sumo_dist.bench.measure.pool_parts import DELAY_MS, FEW, RolloutTimer, overheads, parts
from sumo_dist.bench.measure.scaling_tables import text
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.dispatch.evaluator import REQUESTS
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import UsageError
from sumo_dist.priority import goes_first
from sumo_dist.provenance import cores
from sumo_dist.terminal import say

SCRIPTED = 6  # workers that answer like slow ones
IF: dict[str, tuple[Callable[[Parts], Parts], int]] = {  # -> the parts then, requests a worker
    "as it is": (lambda parts: parts, REQUESTS),
    "rollouts all take the same time": (
        lambda parts: replace(parts, rollout=parts.rollout.without_spread()),
        REQUESTS,
    ),
    "each request costs half": (
        lambda parts: replace(parts, overhead_ms=[ms / 2 for ms in parts.overhead_ms]),
        REQUESTS,
    ),
    "one request a worker": (lambda parts: parts, 1),
    "messages cost nothing beyond the first": (free_messages, REQUESTS),
    "a plan's base is half": (lambda parts: replace(parts, base_ms=parts.base_ms / 2), REQUESTS),
}


@dataclass(frozen=True)
class Options:
    """Options of `bench scaling`.

    Attributes:
        json: print one JSON object.
        robot: spot or g1.
        workers: numbers of them to time messages with and to predict for.
        rollouts: of the plans that are predicted and made; the other predictions are of as many as
            fit into a plan's period.
        plans: timed, of each kind.
        real: workers on this machine to compare with; by default one for each core, at most 4.
        slowdown: of the six scripted workers to compare with.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
    """

    json: bool = False
    robot: str = "spot"
    workers: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64, 128, 256)
    rollouts: int = 32
    plans: int = 40
    real: int | None = None
    slowdown: float = 3.0
    engine: str = "auto"

    def __post_init__(self) -> None:
        check_at_least(1, rollouts=self.rollouts, plans=self.plans, real=self.real)
        for number in self.workers:
            check_at_least(1, workers=number)
        if not self.workers:
            raise UsageError("workers: name at least one number of them")
        if not 0 < self.slowdown <= 100:
            raise UsageError(f"slowdown must be in (0, 100], got {self.slowdown}")


def main(options: Options) -> int:
    """Measure, predict, compare, and print tables or one JSON object."""
    robot = f" --robot {options.robot}" if options.robot != "spot" else ""
    run_bench(f"bench scaling{robot}", options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Measure the parts, predict from them, and make plans to compare with."""
    name, _ = checked_engine(options.engine)
    snapshot = Snapshot.load(options.robot)
    episode = Episode.assemble(EpisodeConfig(snapshot.task, engine=options.engine))
    with Bench.start(episode, snapshot, options.plans, options.engine) as bench:
        priority = "real-time" if goes_first() else "normal"
        with RolloutTimer(episode, snapshot, options.engine) as timer:
            rollout = timer.times(options.plans)
            say("rollouts timed")
            made = overheads(bench, options.workers)
            found = parts(rollout, made)
            checks = [*by_real(options, bench, found, timer), *by_scripted(options, bench, found)]
            in_time = in_time_checks(options, bench, found)
    about = {"engine": name, "task": snapshot.task, "plans": options.plans, "priority": priority}
    return {
        **about,
        "rollouts": options.rollouts,
        "rollout": rollout_rows(found),
        "messages": [message_row(*kind, of_it) for kind, of_it in sorted(made.items())],
        "row_ms": round(found.row_ms, 4),
        "idle_ms": round(found.idle_ms, 4),
        "limits": limits(found, made),
        "checks": checks,
        "in_time_checks": in_time,
        "predicted": predictions(options, found),
        "changes": changes(options, found),
    }


def by_real(
    options: Options, bench: Bench, found: Parts, timer: RolloutTimer
) -> Iterator[dict[str, Any]]:
    """Compare with plans of real workers; the rollouts it is predicted from are timed in turn."""
    real = options.real or min(4, cores())
    with bench.real(real):
        for rollouts in numbers(options):
            _, rows = requests(real, rollouts, None)
            samples: dict[int, list[float]] = {int(size): [] for size in {1, 2, *rows}}

            def time_rollouts() -> None:
                for size, of_it in samples.items():  # noqa: B023
                    of_it.append(timer(size))

            made = bench.timed(real, rollouts, time_rollouts)
            of_now = replace(found, rollout=RolloutTimes.of(samples))
            yield check_row(f"{real} real", made, predict(of_now, real, rollouts, PERIOD_MS))


def by_scripted(options: Options, bench: Bench, found: Parts) -> Iterator[dict[str, Any]]:
    """Compare with plans of scripted workers that take as long as slow ones."""
    slow = replace(found, rollout=found.rollout.slowed(options.slowdown))
    with bench.scripted(SCRIPTED, slow.rollout):
        for rollouts in numbers(options):
            made = bench.timed(SCRIPTED, rollouts)
            expected = predict(slow, SCRIPTED, rollouts, PERIOD_MS)
            yield check_row(f"{SCRIPTED} scripted, {options.slowdown:g}x slower", made, expected)


def in_time_checks(options: Options, bench: Bench, found: Parts) -> list[dict[str, Any]]:
    """Ask in realtime for as many rollouts as should fit, and compare how many are in time."""
    rollouts = most_that_fit(found, SCRIPTED, rows_a_request(found))
    with bench.scripted(SCRIPTED, found.rollout):
        bench.timed(SCRIPTED, options.rollouts)
        measured = bench.in_time(SCRIPTED, rollouts)
    predicted = predict_realtime(found, SCRIPTED, rollouts, rows_a_request(found)).in_time
    return [
        {
            "what": f"{SCRIPTED} scripted",
            "rollouts": rollouts,
            "measured": round(measured, 2),
            "predicted": round(predicted, 2),
            "off": round(predicted / max(measured, 1e-3) - 1.0, 4),
        }
    ]


def numbers(options: Options) -> list[int]:
    """Return the rollouts of the plans that are compared."""
    return sorted({max(1, options.rollouts // 2), options.rollouts})


def check_row(what: str, made: Made, expected: Prediction) -> dict[str, Any]:
    """Compare plans with a prediction of them."""
    p50, p99 = np.percentile(made.plan_ms, (50, 99))
    return {
        "what": what,
        "rollouts": expected.rollouts,
        "measured_ms": round(float(p50), 2),
        "predicted_ms": round(expected.p50_ms, 2),
        "off": round(expected.p50_ms / float(p50) - 1.0, 4),
        "measured_p99_ms": round(float(p99), 2),
        "predicted_p99_ms": round(expected.p99_ms, 2),
    }


def predictions(options: Options, found: Parts) -> list[dict[str, Any]]:
    """Predict plans for each number of workers."""
    return [predicted(options.rollouts, workers, found) for workers in sorted(set(options.workers))]


def predicted(rollouts: int, workers: int, found: Parts) -> dict[str, Any]:
    """Predict plans on some workers: of some rollouts, and of as many as fit.

    The efficiency of the first is the speed-up over one worker, per worker; that of the second is
    against the same workers if their messages cost nothing.
    """
    alone, of_it = (predict(found, n, rollouts, PERIOD_MS) for n in (1, workers))
    fit = most_that_fit(found, workers, rows_a_request(found))
    free = most_that_fit(free_messages(found), workers, rows_a_request(found))
    return {
        "workers": workers,
        "p50_ms": round(of_it.p50_ms, 2),
        "p99_ms": round(of_it.p99_ms, 2),
        "in_time": round(of_it.in_time, 2),
        "efficiency": round(alone.p50_ms / of_it.p50_ms / workers, 4),
        "fit": fit,
        "fit_efficiency": round(fit / free, 4),
    }


def rows_a_request(found: Parts, requests: int = REQUESTS) -> int:
    """Return the rows of a request with a deadline: a worker gets some, one after the other."""
    a_row_ms = found.rollout.medians_ms[-1] / found.rollout.sizes[-1]
    return max(1, int(PERIOD_MS / a_row_ms / requests))


def changes(options: Options, found: Parts) -> list[dict[str, Any]]:
    """Say what would move the predictions for a few workers and for the most."""
    few, most = min(FEW, max(options.workers)), max(options.workers)
    free = most_that_fit(free_messages(found), most, rows_a_request(found))
    rows = []
    for change, (apply, requests_each) in IF.items():
        then = apply(found)
        small = predicted(options.rollouts, few, then)
        fit = most_that_fit(then, most, rows_a_request(then, requests_each))
        kept = {name: small[name] for name in ("p50_ms", "efficiency")}
        rows.append({"change": change, **kept, "fit": fit, "fit_efficiency": round(fit / free, 4)})
    return rows


def limits(found: Parts, made: Mapping[tuple[int, int], Made]) -> dict[str, Any]:
    """Say where optimizer and router alone would fill a plan's period."""
    most = found.requests[-1]
    added = max(1, most - 1)
    router_ms = (made[most, most].router_cpu_ms - made[1, 1].router_cpu_ms) / (2 * added)
    takes = found.base_ms + found.overhead(np.arange(most) + 1)
    full = (np.flatnonzero(takes > PERIOD_MS) + 1).tolist()
    return {
        "base_ms": round(found.base_ms, 2),
        "request_ms": round(found.overhead_ms[-1] / added, 4),
        "router_cpu_ms_per_message": round(router_ms, 4),
        "requests_that_fill_a_period": full[0] if full else None,
        "requests_that_fill_the_router": round(PERIOD_MS / (2 * router_ms))
        if router_ms > 0
        else None,
    }


def rollout_rows(found: Parts) -> list[dict[str, Any]]:
    """Rows of the rollouts' table."""
    times = found.rollout
    return [
        {
            "rows": size,
            "median_ms": round(median, 3),
            "a_row_ms": round(median / size, 3),
            "p99": round(float(np.percentile(factors, 99)), 3),
        }
        for size, median, factors in zip(times.sizes, times.medians_ms, times.factors, strict=True)
    ]


def message_row(workers: int, rollouts: int, made: Made) -> dict[str, Any]:
    """Row of the messages' table."""
    return {
        "workers": workers,
        "rollouts": rollouts,
        "plan_ms": round(made.median_ms - DELAY_MS, 3),
        "own_ms": round(float(np.median(made.own_ms)), 3),
        "optimizer_cpu_ms": round(made.optimizer_cpu_ms, 3),
        "router_cpu_ms": round(made.router_cpu_ms, 3),
    }
