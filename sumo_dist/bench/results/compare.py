"""`sumo-dist bench compare`: what changed between two campaigns, and whether it is significant."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tyro

from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.cost import HEAD as COST_HEAD
from sumo_dist.bench.results.cost import NOTE as COST_NOTE
from sumo_dist.bench.results.cost import Cost, cost_cells
from sumo_dist.bench.results.journal import PLANNED, USUAL, read_rows
from sumo_dist.bench.results.outcomes import JOURNAL, Count, Row, count_tasks
from sumo_dist.bench.results.stats import ALPHA, Ratio, fisher, holm, newcombe, paired_ratio
from sumo_dist.bench.results.tables import MOTION_HEAD, MOTION_NOTE, motion_cells
from sumo_dist.episode.motion import MEASURES
from sumo_dist.errors import UsageError
from sumo_dist.timing import TICK

HEAD = ("task", "A", "B", "difference", "95 %", "p", "both solved", "time B / A", "95 %", "p")
NOTE = (
    f"Significant means p < {ALPHA:g}: of Fisher's exact test for success, of Wilcoxon's "
    "signed-rank test for completion times, seed by seed; p of single tasks in the sentences "
    "is adjusted for their number (Holm), in the table it is not."
)


@dataclass(frozen=True)
class Options:
    """Options of `bench compare`.

    Attributes:
        a: folder of `bench suite` or file of `bench episodes`.
        b: what is compared with it.
    """

    a: Annotated[Path, tyro.conf.Positional]
    b: Annotated[Path, tyro.conf.Positional]


class Change(NamedTuple):
    """What changed in one task."""

    a: Count
    b: Count
    p: float  # of Fisher's exact test that the success rates are the same
    times: Ratio | None  # completion times of B over those of A, by the seeds that both solved

    @classmethod
    def between(cls, a: Count, b: Count) -> "Change":
        """Compare trials of the same tasks."""
        first, second = (
            {(r["task"], r["seed"]): max(r["completion_time_s"], TICK) for r in count.solved}
            for count in (a, b)
        )
        pairs = [(time, second[key]) for key, time in first.items() if key in second]
        times = paired_ratio(*zip(*pairs, strict=True)) if pairs else None
        return cls(a, b, fisher((a.successes, b.successes), (a.trials, b.trials)), times)


def main(options: Options) -> int:
    """Print a table, a sentence a task, and the settings that differ."""
    print(text(load(options.a), load(options.b), str(options.a), str(options.b)))
    return 0


def load(path: Path) -> list[Row]:
    """Rows of a campaign, without its controls."""
    rows = read_rows(path / JOURNAL if path.is_dir() else path)
    return [row for row in rows if row["variant"] == PLANNED]


def text(a: Sequence[Row], b: Sequence[Row], name_a: str, name_b: str) -> str:
    """Lay out a comparison.

    Raises:
        UsageError: the two have no task in common.
    """
    tasks = common_tasks(a, b)
    alone = sorted({row["task"] for row in (*a, *b)} - {*tasks})
    a, b = ([row for row in rows if row["task"] in tasks] for rows in (a, b))
    of_a, of_b = count_tasks(a), count_tasks(b)
    changes = [Change.between(of_a[task], of_b[task]) for task in tasks]
    rates = holm([change.p for change in changes])
    times = holm([change.times.p if change.times else 1.0 for change in changes])
    verdicts = [sentence(*each) for each in zip(changes, rates, times, strict=True)]
    if len(changes) > 1:
        total = Change.between(Count("all tasks", a), Count("all tasks", b))
        verdicts.append(sentence(total, total.p, total.times.p if total.times else 1.0))
        changes.append(total)
    motion = [line for change in changes for line in motion_lines(change)]
    costs = [line for change in changes for line in cost_lines(change)]
    settings = differences(a, b) or ["All settings are the same."]
    settings += [f"only one of the two has {task}" for task in alone]
    return "\n\n".join(
        (
            f"# A: {name_a}, B: {name_b}",
            markdown(HEAD, [cells(change) for change in changes]),
            bullets(verdicts),
            NOTE,
            *(["## Cost", COST_NOTE, markdown(("task", *COST_HEAD), costs)] if costs else []),
            *(["## Motion", MOTION_NOTE, markdown(MOTION_HEAD, motion)] if motion else []),
            f"## What differs\n\n{bullets(settings)}",
        )
    )


def common_tasks(a: Sequence[Row], b: Sequence[Row]) -> list[str]:
    """Tasks that both have, in the order of A."""
    of_a, of_b = (dict.fromkeys(row["task"] for row in rows) for rows in (a, b))
    common = [task for task in of_a if task in of_b]
    if not common:
        raise UsageError(
            f"A and B have no task in common: {', '.join(of_a) or 'no trials'} in A, "
            f"{', '.join(of_b) or 'no trials'} in B"
        )
    return common


def sentence(change: Change, p_rate: float, p_time: float) -> str:
    """Say what changed in a task, and whether it is significant."""
    a, b = change.a, change.b
    more = "no change" if a.rate == b.rate else "more" if b.rate > a.rate else "fewer"
    said = f"{a.task}: {a} -> {b} solved, {_verdict(more, p_rate)}"
    if change.times is None:
        return f"{said}; no seed that both solved."
    ratio, pairs = change.times.value, change.times.pairs
    faster = "as fast" if round(ratio, 3) == 1 else "faster" if ratio < 1 else "slower"
    how = _verdict(faster, p_time)
    return f"{said}; it takes {ratio:.2f} times as long over {pairs} seeds, {how}."


def cells(change: Change) -> tuple[str, ...]:
    """Return a task's cells."""
    a, b, t = change.a, change.b, change.times
    low, high = newcombe((a.successes, b.successes), (a.trials, b.trials))
    rates = (f"{b.rate - a.rate:+.2f}", f"{low:+.2f} to {high:+.2f}", f"{change.p:.3f}")
    times = ("0", "-", "-", "-")
    if t is not None:
        interval = f"{t.low:.2f} to {t.high:.2f}" if t.low > 0 else "-"
        times = (str(t.pairs), f"{t.value:.2f}", interval, f"{t.p:.3f}")
    return (a.task, str(a), str(b), *rates, *times)


def motion_lines(change: Change) -> list[list[str]]:
    """Return a task's motion in both, and of B the share of A's; empty if one does not have it."""
    a, b = change.a.motion, change.b.motion
    if not a or not b:
        return []
    shares = (b[name] / a[name] if a.get(name) and name in b else None for name in MEASURES)
    ratios = ["-" if share is None else f"{share:.2f}" for share in shares]
    return [
        [f"{change.a.task}, A", *motion_cells(a)],
        [f"{change.a.task}, B", *motion_cells(b)],
        ["B / A", *ratios],
    ]


def cost_lines(change: Change) -> list[tuple[str, ...]]:
    """Return what a task cost in both, and of B the share of A's; empty if one does not say."""
    a, b = Cost.of(change.a.rows), Cost.of(change.b.rows)
    if a is None or b is None:
        return []
    both_solved = math.isfinite(a.solved_s) and math.isfinite(b.solved_s)
    return [
        (f"{change.a.task}, A", *cost_cells(a)),
        (f"{change.a.task}, B", *cost_cells(b)),
        (
            "B / A",
            f"{b.plan_ms / a.plan_ms:.2f}",
            f"{b.solved_s / a.solved_s:.2f}" if both_solved else "-",
            "-",
        ),
    ]


def differences(a: Sequence[Row], b: Sequence[Row]) -> list[str]:
    """Say which settings differ, and what else the trials were made with and on."""
    of_a, of_b = _settings(a), _settings(b)
    return [
        f"{name}: {' and '.join(of_a[name])} -> {' and '.join(of_b.get(name, ())) or 'none'}"
        for name in of_a
        if of_a[name] != of_b.get(name)
    ]


def _settings(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Every value that each setting has; of the tasks, where they have their own."""
    found: dict[str, dict[str, None]] = {}
    for row in rows:
        flat: Mapping[str, Any] = {
            **row["planner"],
            **{name: row.get(name, usual) for name, usual in USUAL.items()},
            "engine_build": row["engine_build"],
            f"{row['task']}, time limit [s]": row["time_limit_s"],
            f"{row['task']}, task and settings": row["config_hash"],
            **row["provenance"],
        }
        for name, value in flat.items():
            found.setdefault(name, {})[str(value)] = None
    return {name: [*values] for name, values in found.items()}


def bullets(lines: Iterable[str]) -> str:
    """Lay out a list."""
    return "\n".join(f"- {line}" for line in lines)


def _verdict(what: str, p: float) -> str:
    if what in ("no change", "as fast"):
        return what
    significance = "significant" if p < ALPHA else "not significant"
    return f"{what} ({significance}, p {'< 0.001' if p < 0.001 else f'= {p:.3f}'})"
