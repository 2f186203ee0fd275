"""`sumo-dist bench realtime`: how long whole plans take, and how many cores 20 Hz needs."""

import math
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sumo_dist.bench.layout import Result, check_at_least, checked_engine, run_bench, table
from sumo_dist.bench.measure.planning import in_process, request
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.bench.measure.variant import timed
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.provenance import cores
from sumo_dist.tasks import load_task
from sumo_dist.terminal import say
from sumo_dist.timing import PLAN_PERIOD

BUDGET_MS = PLAN_PERIOD * 1e3  # of a plan at 20 Hz
WARM_UP = 2  # plans that are not counted

COLUMNS = {
    "rollouts": "{rollouts}",
    "threads": "{threads}",
    "plan, median [ms]": "{wall_ms_median:.1f}",
    "min": "{wall_ms_min:.1f}",
    "processor time [ms]": "{cpu_ms_median:.1f}",
    "of real time": "{realtime_factor:.2f}",
}
NEEDS = {"rollouts": "{rollouts}", "cores that 20 Hz needs": "{text}"}


@dataclass(frozen=True)
class Options:
    """Options of `bench realtime`.

    Attributes:
        json: print one JSON object.
        robot: spot or g1.
        rollouts: per plan, a row each.
        threads: that share them, a row each; by default 1, 2, 4 ... up to one for each core.
        repeats: timed plans of every row.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
    """

    json: bool = False
    robot: str = "spot"
    rollouts: tuple[int, ...] = (8, 16, 32, 64)
    threads: tuple[int, ...] = ()
    repeats: int = 15
    engine: str = "auto"

    def __post_init__(self) -> None:
        check_at_least(1, repeats=self.repeats)
        for name in ("rollouts", "threads"):
            for number in getattr(self, name):
                check_at_least(1, **{name: number})


def main(options: Options) -> int:
    """Time, and print tables or one JSON object."""
    robot = f" --robot {options.robot}" if options.robot != "spot" else ""
    run_bench(f"bench realtime{robot}", options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Time plans of all rows in turn, in this process."""
    name, _ = checked_engine(options.engine)
    threads = options.threads or powers(cores())
    plans: dict[tuple[int, int], Callable[[int], Any]] = {}
    times: dict[tuple[int, int], list[tuple[float, float]]] = {}
    with ExitStack() as stack:
        for rollouts in options.rollouts:
            for number in threads:
                row = rollouts, number
                plans[row], times[row] = planner(stack, options, *row), []
        for number in range(1, options.repeats + WARM_UP + 1):
            for row, plan in plans.items():
                wall, cpu, _ = timed(partial(plan, number))
                if number > WARM_UP:
                    times[row].append((wall, cpu))
        say(f"{options.repeats} plans of {len(plans)} rows")
    rows = [summary(*row, found) for row, found in times.items()]
    needs = [need(n, [row for row in rows if row["rollouts"] == n]) for n in options.rollouts]
    about = {"engine": name, "task": Snapshot.load(options.robot).task, "cores": cores()}
    return {**about, "repeats": options.repeats, "rows": rows, "needs": needs}


def powers(most: int) -> tuple[int, ...]:
    """1, 2, 4 ... and the most."""
    return tuple(sorted({*(2**i for i in range(most.bit_length())), most}))


def planner(
    stack: ExitStack, options: Options, rollouts: int, threads: int
) -> Callable[[int], Any]:
    """Return what makes plans of so many rollouts on so many threads, by number."""
    snapshot = Snapshot.load(options.robot)
    settings = PlannerConfig.resolve(load_task(snapshot.task).planner)
    config = EpisodeConfig(
        snapshot.task,
        planner=settings.changed({"rollouts": rollouts}),
        engine=options.engine,
    )
    episode = Episode.assemble(config)
    plan = stack.enter_context(in_process(episode, threads))
    return lambda number: plan(request(episode, snapshot, number))


def summary(rollouts: int, threads: int, times: Iterable[tuple[float, float]]) -> dict[str, Any]:
    """Return the row of some plans: wall and processor times [ms]."""
    wall, cpu = np.array(list(times)).T
    median = float(np.median(wall))
    return {
        "rollouts": rollouts,
        "threads": threads,
        "wall_ms_median": round(median, 2),
        "wall_ms_min": round(float(wall.min()), 2),
        "cpu_ms_median": round(float(np.median(cpu)), 2),
        "realtime_factor": round(min(1.0, BUDGET_MS / median), 3),
    }


def need(rollouts: int, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Say how many cores 20 Hz needs: the fewest that were in time, or a lower bound."""
    in_time = [row["threads"] for row in rows if row["wall_ms_median"] <= BUDGET_MS]
    if in_time:
        least, measured = min(in_time), True
    else:
        least, measured = at_least(min(row["cpu_ms_median"] for row in rows)), False
    text = str(least) if measured else f"at least {least}"
    return {"rollouts": rollouts, "cores": least, "measured": measured, "text": text}


def at_least(cpu_ms: float) -> int:
    """Cores that a plan of so much processor time needs for 20 Hz, if sharing it costs nothing."""
    return math.ceil(cpu_ms / BUDGET_MS)


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"Plans of {result['task']} with its settings but for the rollouts, in one process, "
        f"{result['engine']}, {result['repeats']} plans of every row in turn."
    )
    yield table(COLUMNS, result["rows"])
    yield (
        f"A plan is in time at 20 Hz if its median is at most {BUDGET_MS:.0f} ms: the fewest "
        f"threads that were. Where {result['cores']} cores were not enough, or busy with something "
        "else, a lower bound: the processor time of a plan over its 50 ms."
    )
    yield table(NEEDS, result["needs"])
