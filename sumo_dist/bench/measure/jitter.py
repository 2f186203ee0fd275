"""`sumo-dist bench jitter`: how late the robot's commands are while rollouts fill all cores.

A realtime run at full speed is repeated with the services that the robot waits for at real-time and
at normal priority, in turn.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sumo_dist.bench.engine import checked_engine
from sumo_dist.bench.layout import heading, markdown
from sumo_dist.episode.summary import read_summary
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.priority import CHOICES, VARIABLE
from sumo_dist.provenance import cores, timing_provenance

START_S = 60.0  # for the services to come up


@dataclass(frozen=True)
class Options:
    """Options of `bench jitter`.

    Attributes:
        json: print one JSON object.
        task: what is done.
        trials: runs of each kind.
        seed0: the first one's seed.
        seconds: of robot time, at most, in each run.
        workers: worker processes of one thread each; by default one for each core.
    """

    json: bool = False
    task: str = "spot/move_box"
    trials: int = 6
    seed0: int = 1
    seconds: float = 8.0
    workers: int | None = None

    def __post_init__(self) -> None:
        counts = (self.trials, 1 if self.workers is None else self.workers)
        if min(counts) < 1 or not 0 < self.seconds <= 3600:
            raise UsageError("trials and workers must be at least 1, seconds in (0, 3600]")


def main(options: Options) -> int:
    """Run both kinds in turn, and print a table or one JSON object."""
    engine, _ = checked_engine("auto")
    about, workers = timing_provenance(), options.workers or cores()
    found: dict[str, list[dict[str, Any]]] = {choice: [] for choice in CHOICES}
    for seed in range(options.seed0, options.seed0 + options.trials):
        for choice in CHOICES if seed % 2 else reversed(CHOICES):
            summary = run(options, workers, seed, choice)
            found[choice].append(summary)
            told = f"seed {seed}, {choice}: p99 {summary['command_late_ms_p99']:.1f} ms"
            print(told, file=sys.stderr, flush=True)
    result = {
        **about,
        "engine": engine,
        "task": options.task,
        "trials": options.trials,
        "seed0": options.seed0,
        "workers": workers,
        "rows": [row(choice, summaries) for choice, summaries in found.items()],
    }
    print(json.dumps(result, indent=1) if options.json else text(result))
    return 0


def run(options: Options, workers: int, seed: int, choice: str) -> dict[str, Any]:
    """Make one run in processes of its own and return its summary."""
    with TemporaryDirectory() as folder:
        flags = {
            "clock": "realtime",
            "speed": 1,
            "seed": seed,
            "time-limit": options.seconds,
            "workers": workers,
            "viewer": "none",
            "listen": "tcp/127.0.0.1:0",
            "out": folder,
        }
        given = [f"--{name}={value}" for name, value in flags.items()]
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", "sumo_dist", "run", options.task, *given],
                env={**os.environ, VARIABLE: choice},
                capture_output=True,
                text=True,
                timeout=START_S + options.seconds,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise SumoError(f"the run with seed {seed} hung for {error.timeout:g} s") from None
        if done.returncode not in (0, 1):
            raise SumoError(f"the run with seed {seed} failed: {done.stderr.strip()[-500:]}")
        if choice != "normal" and f"{choice} priority" not in done.stderr:
            raise SumoError("real-time priority is not permitted here, see `sumo-dist doctor`")
        return read_summary(Path(folder))


def row(choice: str, summaries: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Put the runs of a kind together."""
    late = {p: [s[f"command_late_ms_{p}"] for s in summaries] for p in ("p50", "p99")}
    return {
        "priority": choice,
        **{f"late_ms_{p}": round(float(np.median(values)), 2) for p, values in late.items()},
        "late_ms_p99_range": [round(min(late["p99"]), 2), round(max(late["p99"]), 2)],
        "plans": sum(s["plans"] for s in summaries),
        "missed": sum(s["missed_deadlines"] for s in summaries),
        "rollouts_lost": sum(s["rollouts_lost"] for s in summaries),
    }


def text(result: dict[str, Any]) -> str:
    """Lay out what was measured."""
    heads = ("priority", "p50 [ms]", "p99 [ms]", "p99 of runs", "plans", "missed", "rollouts lost")
    lines = [
        (
            row["priority"],
            f"{row['late_ms_p50']:.1f}",
            f"{row['late_ms_p99']:.1f}",
            "{:.1f} to {:.1f}".format(*row["late_ms_p99_range"]),
            *(str(row[name]) for name in ("plans", "missed", "rollouts_lost")),
        )
        for row in result["rows"]
    ]
    last = result["seed0"] + result["trials"] - 1
    return "\n\n".join(
        (
            heading("bench jitter", result),
            f"{result['task']}, seeds {result['seed0']} to {last}, at the speed of the wall clock, "
            f"{result['workers']} workers of one thread, {result['engine']}. From the instant a "
            "tick of the policy is due to its joint command, through estimator and policy; medians "
            "over runs, and the range of their p99.",
            markdown(heads, lines),
        )
    )
