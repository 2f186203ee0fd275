"""`sumo-dist chaos SCRIPT...`: runs in which things go wrong on purpose, and a verdict on each."""

import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from sumo_dist.bench.report import heading, markdown, timing_provenance
from sumo_dist.chaos.script import read_script
from sumo_dist.chaos.stage import play
from sumo_dist.chaos.verdict import Outcome
from sumo_dist.errors import UsageError


@dataclass(frozen=True)
class Options:
    """Options of `chaos`.

    Attributes:
        scripts: TOML files of faults; deploy/chaos has some.
        episodes: runs of each script, with the seeds that follow its own.
        json: print one JSON object.
        keep: folder for the runs' files.
    """

    scripts: Annotated[tuple[Path, ...], tyro.conf.Positional]
    episodes: int = 1
    json: bool = False
    keep: Path | None = None

    def __post_init__(self) -> None:
        if not self.scripts:
            raise UsageError("chaos needs at least one fault script, such as those of deploy/chaos")
        if self.episodes < 1:
            raise UsageError(f"episodes must be at least 1, got {self.episodes}")


def main(options: Options) -> int:
    """Run every script; 1 if one was not as it must be."""
    scripts = [read_script(path) for path in options.scripts]
    about, outcomes = timing_provenance(), []
    for script in scripts:
        for episode in range(options.episodes):
            seeded = replace(script, seed=script.seed + episode)
            keep = options.keep / f"{script.name}-{seeded.seed}" if options.keep else None
            outcome = play(seeded, keep)
            outcomes.append(outcome)
            verdict = "; ".join(outcome.failures) or "as it must be"
            print(f"{script.name} seed {seeded.seed}: {verdict}", file=sys.stderr, flush=True)
    result = {**about, "outcomes": [asdict(outcome) for outcome in outcomes]}
    print(json.dumps(result, indent=1) if options.json else text(result, outcomes))
    return int(any(outcome.failures for outcome in outcomes))


def text(about: dict[str, Any], outcomes: list[Outcome]) -> str:
    """Lay out the verdicts, one line a script."""
    rows = []
    for name in dict.fromkeys(outcome.name for outcome in outcomes):
        runs = [outcome for outcome in outcomes if outcome.name == name]
        waits = [run.slowest_s for run in runs if run.slowest_s is not None]
        rows.append(
            (
                *(name, f"{len(runs)}", f"{sum(run.faults for run in runs)}"),
                f"{sum(run.plans for run in runs)}",
                f"{sum(run.commands for run in runs)}",
                f"{max(waits):.2f}" if waits else "-",
                f"{max(run.growth_mb for run in runs):.0f}",
                f"{sum(1 for run in runs if run.failures)}",
            )
        )
    faults, failed = sum(o.faults for o in outcomes), sum(1 for o in outcomes if o.failures)
    heads = (
        "script",
        "runs",
        "faults",
        "plans",
        "commands",
        "resumed [s]",
        "growth [MB]",
        "failed",
    )
    failures = [f"- {o.name} seed {o.seed}: {line}" for o in outcomes for line in o.failures]
    return "\n\n".join(
        (
            heading("chaos", about),
            f"{len(outcomes)} runs, {faults} faults, {sum(o.commands for o in outcomes)} commands, "
            f"{failed} runs not as they must be. Resumed: the longest wall time from a fault's end "
            "to the next good plan. Growth: the most that a process grew in a run.",
            markdown(heads, rows),
            *(["\n".join(failures)] if failures else []),
        )
    )
