"""`sumo-dist bench jitter`: how late the robot's commands are while rollouts fill all cores.

A realtime run at full speed is repeated with the services that the robot waits for at real-time and
at normal priority, in turn.
"""

import os
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sumo_dist.bench.layout import Result, run_bench, table
from sumo_dist.bench.measure.runs import SAID, RunOptions
from sumo_dist.episode.summary import read_summary
from sumo_dist.errors import SumoError
from sumo_dist.priority import CHOICES, VARIABLE
from sumo_dist.terminal import say

START_S = 60.0  # for the services to come up
COLUMNS = {
    "priority": "{priority}",
    "p50 [ms]": "{late_ms_p50:.1f}",
    "p99 [ms]": "{late_ms_p99:.1f}",
    "p99 of runs": "{late_ms_p99_range[0]:.1f} to {late_ms_p99_range[1]:.1f}",
    "plans": "{plans}",
    "missed": "{missed}",
    "rollouts lost": "{rollouts_lost}",
}


@dataclass(frozen=True)
class Options(RunOptions):
    """Options of `bench jitter`; see also RunOptions."""

    trials: int = 6
    seconds: float = 8.0


def main(options: Options) -> int:
    """Run both kinds in turn, and print a table or one JSON object."""
    run_bench("bench jitter", options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Run every seed with each priority."""
    about = options.about()
    summaries: dict[str, list[dict[str, Any]]] = {choice: [] for choice in CHOICES}
    for seed in options.seeds:
        for choice in CHOICES if seed % 2 else reversed(CHOICES):
            summary = run(options, seed, choice)
            summaries[choice].append(summary)
            say(f"seed {seed}, {choice}: p99 {summary['command_late_ms_p99']:.1f} ms")
    rows = [row(choice, found) for choice, found in summaries.items()]
    return {**about, "workers": options.processes, "rows": rows}


def run(options: Options, seed: int, choice: str) -> dict[str, Any]:
    """Make one run in processes of its own and return its summary."""
    with TemporaryDirectory() as folder:
        try:
            done = subprocess.run(
                options.command(seed, folder, clock="realtime", speed=1, viewer="none"),
                env={**os.environ, VARIABLE: choice},
                capture_output=True,
                text=True,
                timeout=START_S + options.seconds,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise SumoError(f"the run with seed {seed} hung for {error.timeout:g} s") from None
        if done.returncode not in (0, 1):
            raise SumoError(f"the run with seed {seed} failed: {done.stderr.strip()[-SAID:]}")
        if choice != "normal" and f"{choice} priority" not in done.stderr:
            raise SumoError("real-time priority is not permitted here, see `sumo-dist doctor`")
        return read_summary(Path(folder))


def row(choice: str, summaries: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return medians, ranges and sums over the runs of a kind."""
    late = {p: [s[f"command_late_ms_{p}"] for s in summaries] for p in ("p50", "p99")}
    return {
        "priority": choice,
        **{f"late_ms_{p}": round(float(np.median(values)), 2) for p, values in late.items()},
        "late_ms_p99_range": [round(min(late["p99"]), 2), round(max(late["p99"]), 2)],
        "plans": sum(s["plans"] for s in summaries),
        "missed": sum(s["missed_deadlines"] for s in summaries),
        "rollouts_lost": sum(s["rollouts_lost"] for s in summaries),
    }


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    last = result["seed0"] + result["trials"] - 1
    yield (
        f"{result['task']}, seeds {result['seed0']} to {last}, at the speed of the wall clock, "
        f"{result['workers']} workers of one thread, {result['engine']}. From the instant a "
        "tick of the policy is due to its joint command, through estimator and policy; medians "
        "over runs, and the range of their p99."
    )
    yield table(COLUMNS, result["rows"])
