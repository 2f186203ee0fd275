"""`sumo-dist chaos SCRIPT...`: runs in which things go wrong on purpose, and a verdict on each."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.bench.layout import Result, check_at_least, markdown, run_bench
from sumo_dist.errors import UsageError
from sumo_dist.faults.growth import Growth
from sumo_dist.faults.run import run_script
from sumo_dist.faults.script import read_script
from sumo_dist.faults.verdict import Outcome, counted
from sumo_dist.record.folders import fresh_folder
from sumo_dist.terminal import say

HEADS = (
    *("script", "runs", "faults", "plans", "commands", "rate [1/s]", "rollouts", "resumed [s]"),
    *("growth [MB]", "growth [files]", "failed"),
)


@dataclass(frozen=True)
class Options:
    """Options of `chaos`.

    Attributes:
        scripts: TOML files of faults; deploy/chaos has some.
        episodes: runs of each script, with the seeds that follow its own.
        json: print one JSON object.
        keep: folder for the runs' files; each run gets a new one in it.
    """

    scripts: Annotated[tuple[Path, ...], tyro.conf.Positional]
    episodes: int = 1
    json: bool = False
    keep: Path | None = None

    def __post_init__(self) -> None:
        if not self.scripts:
            raise UsageError("chaos needs at least one fault script, such as those of deploy/chaos")
        check_at_least(1, episodes=self.episodes)


def main(options: Options) -> int:
    """Run every script; 1 if one was not as it must be."""
    scripts = [read_script(path) for path in options.scripts]
    outcomes: list[Outcome] = []

    def run_all() -> Result:
        for script in scripts:
            for episode in range(options.episodes):
                seeded = replace(script, seed=script.seed + episode)
                name = f"{script.name}-{seeded.seed}"
                keep = fresh_folder(options.keep / name) if options.keep else None
                outcomes.append(outcome := run_script(seeded, keep))
                verdict = "; ".join(outcome.failures) or "as it must be"
                say(f"{script.name} seed {seeded.seed}: {verdict}")
        return {"outcomes": [asdict(outcome) for outcome in outcomes]}

    run_bench("chaos", options.json, run_all, lambda _: text(outcomes))
    return int(any(outcome.failures for outcome in outcomes))


def text(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Lay out the verdicts, one line a script; of a single run, its services as well."""
    faults, failed = sum(o.faults for o in outcomes), sum(1 for o in outcomes if o.failures)
    yield (
        f"{len(outcomes)} runs, {faults} faults, {sum(o.commands for o in outcomes)} commands, "
        f"{failed} runs not as they must be. Resumed: the longest wall time from the end of a "
        "fault, and of all that overlap it, to the next good plan. Rate: plans per second of "
        "wall time; rollouts: median a plan (both: the least of the script's runs). Growth: "
        "the most that a process other than the tracer grew in the second half of its life."
    )
    names = dict.fromkeys(outcome.name for outcome in outcomes)
    yield markdown(HEADS, [row([o for o in outcomes if o.name == name]) for name in names])
    notes = [f"- {o.name} seed {o.seed}: {line}" for o in outcomes for line in o.failures]
    notes += [
        f"- {o.name} seed {o.seed}: it fell, as it does without faults"
        for o in outcomes
        if o.end == o.undisturbed
    ]
    if notes:
        yield "\n".join(notes)
    if len(outcomes) == 1:
        yield services(outcomes[0].growths)


def row(runs: Sequence[Outcome]) -> tuple[str, ...]:
    """Lay out the runs of one script."""
    waits = [run.slowest_s for run in runs if run.slowest_s is not None]
    growths = [growth for run in runs for growth in counted(run.growths)]
    return (
        *(runs[0].name, f"{len(runs)}", f"{sum(run.faults for run in runs)}"),
        *(f"{sum(run.plans for run in runs)}", f"{sum(run.commands for run in runs)}"),
        f"{min(run.rate_hz for run in runs):.1f}",
        f"{min(run.rollouts for run in runs):g}",
        f"{max(waits):.2f}" if waits else "-",
        f"{max((g.mb[1] - g.mb[0] for g in growths), default=0.0):.1f}",
        f"{max((g.files[1] - g.files[0] for g in growths), default=0.0):.0f}",
        f"{sum(1 for run in runs if run.failures)}",
    )


def services(growths: Sequence[Growth]) -> str:
    """Lay out how the services of one run have grown."""
    heads = (
        *("service", "lives", "longest [s]", "middle [MB]", "end [MB]"),
        *("middle [files]", "end [files]"),
    )
    rows = [
        (g.service, f"{g.lives}", f"{g.seconds:.0f}", *(f"{x:.1f}" for x in (*g.mb, *g.files)))
        for g in growths
    ]
    return "Memory and open files of each service over its longest life.\n\n" + markdown(
        heads, rows
    )
