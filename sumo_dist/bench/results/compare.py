"""`sumo-dist bench compare`: what changed between two campaigns, and whether it is significant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tyro

from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.journal import PLANNED, USUAL, read_rows
from sumo_dist.bench.results.outcomes import JOURNAL, Count, Row, count_tasks
from sumo_dist.bench.results.stats import ALPHA, Ratio, fisher, holm, newcombe, paired_ratio
from sumo_dist.errors import UsageError
from sumo_dist.timing import TICK

HEAD = ("task", "A", "B", "difference", "95 %", "p", "both solved", "time B / A", "95 %", "p")


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
    """What changed in one task.

    Attributes:
        task: its name, or "all tasks".
        successes, trials: of A and of B.
        p: of Fisher's exact test that the success rates are the same.
        times: completion times of B over those of A, by the seeds that both solved; None if none.
    """

    task: str
    successes: tuple[int, int]
    trials: tuple[int, int]
    p: float
    times: Ratio | None

    @classmethod
    def between(cls, task: str, a: Sequence[Row], b: Sequence[Row]) -> "Change":
        """Compare rows of the same tasks."""
        counts = Count(task, a), Count(task, b)
        successes = counts[0].successes, counts[1].successes
        trials = counts[0].trials, counts[1].trials
        solved = [
            {
                (r["task"], r["seed"]): max(r["completion_time_s"], TICK)
                for r in rows
                if r["success"]
            }
            for rows in (a, b)
        ]
        pairs = [(time, solved[1][key]) for key, time in solved[0].items() if key in solved[1]]
        times = paired_ratio(*zip(*pairs, strict=True)) if pairs else None
        return cls(task, successes, trials, fisher(successes, trials), times)


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
    changes, total = compare(a, b)
    alone = {*count_tasks(a)} ^ {*count_tasks(b)}
    a, b = ([row for row in rows if row["task"] not in alone] for rows in (a, b))
    verdicts = [sentence(change, *ps) for change, *ps in adjusted(changes)]
    if len(changes) > 1:
        verdicts.append(sentence(total, total.p, total.times.p if total.times else 1.0))
    lines = [line(change) for change in (*changes, *([total] if len(changes) > 1 else ()))]
    note = (
        f"Significant means p < {ALPHA:g}: of Fisher's exact test for success, of Wilcoxon's "
        "signed-rank test for completion times, seed by seed; p of single tasks in the sentences "
        "is adjusted for their number (Holm), in the table it is not."
    )
    settings = differences(a, b) or ["All settings are the same."]
    settings += [f"only one of the two has {task}" for task in sorted(alone)]
    return "\n\n".join(
        (
            f"# A: {name_a}, B: {name_b}",
            markdown(HEAD, lines),
            "\n".join(f"- {verdict}" for verdict in verdicts),
            note,
            "## What differs\n\n" + "\n".join(f"- {setting}" for setting in settings),
        )
    )


def compare(a: Sequence[Row], b: Sequence[Row]) -> tuple[list[Change], Change]:
    """Compare the tasks that both have, one by one and all together."""
    tasks_a, tasks_b = count_tasks(a), count_tasks(b)
    common = [task for task in tasks_a if task in tasks_b]
    if not common:
        raise UsageError(
            f"A and B have no task in common: {', '.join(tasks_a) or 'no trials'} in A, "
            f"{', '.join(tasks_b) or 'no trials'} in B"
        )
    changes = [Change.between(task, tasks_a[task].rows, tasks_b[task].rows) for task in common]
    of_common = [[row for row in rows if row["task"] in common] for rows in (a, b)]
    return changes, Change.between("all tasks", *of_common)


def adjusted(changes: Sequence[Change]) -> list[tuple[Change, float, float]]:
    """Each task with its p of success and of time, adjusted for the number of tasks."""
    rates = holm([change.p for change in changes])
    times = holm([change.times.p if change.times else 1.0 for change in changes])
    return list(zip(changes, rates, times, strict=True))


def sentence(change: Change, p_rate: float, p_time: float) -> str:
    """Say what changed in a task, and whether it is significant."""
    (k, m), (n, o) = change.successes, change.trials
    said = f"{change.task}: {k}/{n} -> {m}/{o} solved, " + _verdict(
        "no change" if k / n == m / o else "more" if m / o > k / n else "fewer", p_rate
    )
    if change.times is None:
        return f"{said}; no seed that both solved."
    ratio = change.times.value
    faster = "as fast" if round(ratio, 3) == 1 else "faster" if ratio < 1 else "slower"
    verdict = _verdict(faster, p_time)
    return f"{said}; it takes {ratio:.2f} times as long over {change.times.pairs} seeds, {verdict}."


def line(change: Change) -> tuple[str, ...]:
    """Return a task's cells."""
    rates = [k / n for k, n in zip(change.successes, change.trials, strict=True)]
    low, high = newcombe(change.successes, change.trials)
    cells = (
        change.task,
        *(f"{k}/{n}" for k, n in zip(change.successes, change.trials, strict=True)),
        f"{rates[1] - rates[0]:+.2f}",
        f"{low:+.2f} to {high:+.2f}",
        f"{change.p:.3f}",
    )
    if change.times is None:
        return (*cells, "0", "-", "-", "-")
    t = change.times
    interval = f"{t.low:.2f} to {t.high:.2f}" if t.low > 0 else "-"
    return (*cells, str(t.pairs), f"{t.value:.2f}", interval, f"{t.p:.3f}")


def differences(a: Sequence[Row], b: Sequence[Row]) -> list[str]:
    """Say which settings differ, and what else the trials were made with and on."""
    found = []
    for name, values in _settings(a).items():
        others = _settings(b).get(name, ())
        if values != others:
            found.append(f"{name}: {_join(values)} -> {_join(others)}")
    return found


def _settings(rows: Sequence[Row]) -> dict[str, tuple[Any, ...]]:
    """Every value that each setting has; of the tasks, where they have their own."""
    found: dict[str, dict[Any, None]] = {}
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
            found.setdefault(name, {})[value] = None
    return {name: tuple(values) for name, values in found.items()}


def _join(values: Sequence[Any]) -> str:
    return " and ".join(map(str, values)) or "none"


def _verdict(what: str, p: float) -> str:
    if what in ("no change", "as fast"):
        return what
    significance = "significant" if p < ALPHA else "not significant"
    return f"{what} ({significance}, p {'< 0.001' if p < 0.001 else f'= {p:.3f}'})"
