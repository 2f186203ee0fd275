"""What searches found, as Markdown: the winners, success against compute, every trial."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.compare import Change, sentence
from sumo_dist.bench.results.outcomes import CELLS, Count
from sumo_dist.bench.results.stats import ALPHA
from sumo_dist.bench.tune.folder import OWN, read_held_out, read_request, read_trials, winner_name
from sumo_dist.bench.tune.results import COMPLETE, LOSS, PRUNED, Tried, best, progress

HOUR = 3600.0
CURVE_NOTE = (
    "Success is the highest share of its seeds that any complete trial has solved until then; CPU "
    "time is that of all episodes, pruned ones included, of planning and simulation, without the "
    "start of processes."
)
PRUNING = (
    "After {first} of {seeds} seeds a trial whose loss is above the median of the complete trials' "
    "at the same number of seeds is given up (optuna's MedianPruner, from 5 complete trials on)."
)
SAMPLER = "optuna's TPE sampler, all dimensions together"


@dataclass(frozen=True)
class Found:
    """A search as the report has it.

    Attributes:
        name: of its folder.
        request: what was asked for.
        trials: so far.
        importances: of the dimensions, by name; empty if they are not known.
    """

    name: str
    request: Mapping[str, Any]
    trials: Sequence[Tried]
    importances: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Read a folder.

        Raises:
            UsageError: it holds no search.
        """
        return cls(str(folder), read_request(folder), read_trials(folder))

    @property
    def cpu_h(self) -> float:
        """CPU time of all trials [h]."""
        return max((trial.cpu_s for trial in self.trials), default=0.0) / HOUR

    def count(self, state: str) -> int:
        """Return how many trials are in a state."""
        return sum(trial.state == state for trial in self.trials)


def text(searches: Sequence[Found], picture: str) -> str:
    """Lay out searches of one task.

    Args:
        searches: what was found.
        picture: name of the file of the picture, beside the report.
    """
    task = searches[0].request["task"]
    parts = [f"# Search for {task}"]
    if len(searches) > 1:
        parts += [markdown(OVERVIEW_HEAD, [_overview(found) for found in searches])]
    parts += [f"![success against CPU hours]({picture})", CURVE_NOTE, LOSS]
    for found in searches:
        level = "##" if len(searches) > 1 else "#"
        if len(searches) > 1:
            parts.append(f"## {Path(found.name).name}")
        parts += _search(found, f"{level}#")
    return "\n\n".join(parts) + "\n"


OVERVIEW_HEAD = (
    *("search", "seed", "trials", "pruned", "CPU [h]", "best", "loss", "trial", "at CPU [h]"),
    *("held out: own", "winner", "time winner / own"),
)


def _overview(found: Found) -> tuple[str, ...]:
    decides, winner = found.request["decides"], best(found.trials)
    begin = (
        *(Path(found.name).name, str(decides["seed"]), str(len(found.trials))),
        *(str(found.count(PRUNED)), f"{found.cpu_h:.3f}"),
    )
    if winner is None:
        return (*begin, *("-" for _ in OVERVIEW_HEAD[len(begin) :]))
    own, won = read_held_out(Path(found.name), winner)
    held = ("-", "-", "-")
    if own:
        change = Change.between(Count(OWN, own), Count(OWN, won))
        held = (str(change.a), str(change.b), f"{change.times.value:.2f}" if change.times else "-")
    solved = f"{winner.solved}/{len(winner.rows)}"
    return (
        *(*begin, solved, f"{winner.loss:.3f}", str(winner.number)),
        *(f"{winner.cpu_s / HOUR:.3f}", *held),
    )


def _search(found: Found, level: str) -> Iterator[str]:
    """Yield the paragraphs of one search."""
    decides, winner = found.request["decides"], best(found.trials)
    seeds = decides["seeds"]
    yield f"`{found.request['command']}`"
    yield _made_by(found)
    yield (
        f"{found.count(COMPLETE)} of {found.request['trials']} trials are complete, "
        f"{found.count(PRUNED)} were pruned, in {found.cpu_h:.3f} h of CPU time; seeds "
        f"{', '.join(map(str, seeds))}; {SAMPLER}, seed {decides['seed']}. "
        + (
            PRUNING.format(first=decides["first"], seeds=len(seeds))
            if decides["first"] < len(seeds)
            else ""
        )
    )
    if faults := [r for t in found.trials for r in t.rows if r["end"] == "fault"]:
        yield f"{len(faults)} episodes ended by a fault, such as {faults[0]['end_reason']}."
    yield markdown(
        ("searched", "from", "to", "scale", "own", "winner", "importance"),
        [*_dimensions(found, winner)],
    )
    if winner is None:
        yield "No trial is complete yet."
        return
    yield (
        f"The winner is trial {winner.number}, loss {winner.loss:.3f}, {winner.solved} of "
        f"{len(winner.rows)} seeds solved. It was chosen by these seeds, so they say nothing of "
        "how much better it is."
    )
    yield from _held_out(found, winner)
    yield f"{level} Success against compute"
    yield markdown(
        ("CPU [h]", "trial", "success", "loss"),
        [
            (f"{s / HOUR:.4f}", str(t.number), f"{t.solved}/{len(t.rows)}", f"{t.loss:.3f}")
            for s, t in progress(found.trials)
        ],
    )
    yield f"{level} Trials"
    names = [*winner.values]
    yield markdown(
        ("trial", *names, "state", "success", "loss", "CPU [s]"),
        [_trial(trial, names) for trial in found.trials],
    )


def _made_by(found: Found) -> str:
    rows = [row for trial in found.trials for row in trial.rows]
    made = {tuple(row["provenance"][key] for key in ("sumo_dist", "machine")) for row in rows}
    return "; ".join(f"sumo-dist {code}, {machine}" for code, machine in sorted(made))


def _dimensions(found: Found, winner: Tried | None) -> Iterator[tuple[str, ...]]:
    for name, searched in found.request["decides"]["searched"].items():
        won = "-" if winner is None else str(winner.values[name])
        weight = f"{found.importances[name]:.2f}" if name in found.importances else "-"
        own = str(searched["own"])
        if "choices" in searched:
            yield name, *("-", "-", ", ".join(map(str, searched["choices"]))), own, won, weight
        else:
            scale = "log" if searched["log"] else "linear"
            yield name, f"{searched['low']:g}", f"{searched['high']:g}", scale, own, won, weight


def _held_out(found: Found, winner: Tried) -> Iterator[str]:
    """Say how the winner does on seeds that the search has not seen, beside the task's own."""
    searched = found.request["decides"]["searched"]
    if all(winner.values[name] == each["own"] for name, each in searched.items()):
        yield "These are the task's own values: no trial did better."
        return
    own, won = read_held_out(Path(found.name), winner)
    if not own:
        yield "It has not been compared with the task's own values on held-out seeds."
        return
    counts = Count(OWN, own), Count(winner_name(winner), won)
    change = Change.between(*counts)
    yield markdown(("held-out seeds", *CELLS), [(count.task, *count.cells()) for count in counts])
    said = sentence(change, change.p, change.times.p if change.times else 1.0)
    seeds = ", ".join(str(row["seed"]) for row in own)
    yield (
        f"From {said} Seeds {seeds}, one after the other of both; significant means p < "
        f"{ALPHA:g}, of Fisher's exact test and of Wilcoxon's signed-rank test seed by seed."
    )


def _trial(trial: Tried, names: Sequence[str]) -> tuple[str, ...]:
    values = (str(trial.values[name]) for name in names)
    solved, cpu = f"{trial.solved}/{len(trial.rows)}", sum(row["cpu_s"] for row in trial.rows)
    return str(trial.number), *values, trial.state, solved, f"{trial.loss:.3f}", f"{cpu:.1f}"
