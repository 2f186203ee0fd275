"""What a campaign found: counts of each task, and the folder of a suite."""

import json
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from sumo_dist.bench.results.journal import PLANNED, STANDING, Trial, read_rows
from sumo_dist.bench.results.stats import wilson
from sumo_dist.bench.results.suites import SUITES, Figure, Suite
from sumo_dist.errors import UsageError

JOURNAL = "trials.jsonl"
REQUEST = "suite.json"
RECORDINGS = "recordings"

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Count:
    """Trials of one task.

    Attributes:
        task: its name.
        rows: of the journal.
    """

    task: str
    rows: Sequence[Row]

    @property
    def trials(self) -> int:
        """How many there are."""
        return len(self.rows)

    @property
    def solved(self) -> list[Row]:
        """The successes."""
        return [row for row in self.rows if row["success"]]

    @property
    def times(self) -> list[float]:
        """Completion times of the successes [s]."""
        return [row["completion_time_s"] for row in self.solved]

    @property
    def median(self) -> float | None:
        """Median of the completion times [s]."""
        return statistics.median(self.times) if self.times else None

    @property
    def successes(self) -> int:
        """How many succeeded."""
        return len(self.times)

    @property
    def rate(self) -> float:
        """Share of successes."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the rate."""
        return wilson(self.successes, self.trials)

    @property
    def endings(self) -> Counter[str]:
        """How many trials ended for which reason; faults are one."""
        return Counter(row["end_reason"].partition(":")[0] for row in self.rows)

    def __str__(self) -> str:
        """Say it in a table: successes of trials."""
        return f"{self.successes}/{self.trials}"

    def cells(self) -> tuple[str, ...]:
        """Successes, rate, interval, median and mean time, as they stand in a table."""
        low, high = self.interval
        times = self.times
        return (
            str(self),
            f"{self.rate:.2f}",
            f"{low:.2f} to {high:.2f}",
            f"{self.median:.2f}" if times else "-",
            f"{statistics.mean(times):.2f}" if times else "-",
        )

    def ended_by(self) -> str:
        """Name the reasons and how often each was."""
        return ", ".join(f"{reason} {n}" for reason, n in self.endings.items())


CELLS = ("success", "rate", "Wilson 95 %", "median [s]", "mean [s]")


def count_tasks(rows: Sequence[Row], variant: str = PLANNED) -> dict[str, Count]:
    """Sort rows by task, in the order in which tasks first come."""
    rows = [row for row in rows if row["variant"] == variant]
    tasks = dict.fromkeys(row["task"] for row in rows)
    return {task: Count(task, [row for row in rows if row["task"] == task]) for task in tasks}


@dataclass(frozen=True)
class TaskResult:
    """One task of a suite.

    Attributes:
        count: of the trials.
        control: of those in which the robot only stands, if there are any.
        figure: what has been published.
    """

    count: Count
    control: Count | None
    figure: Figure

    @property
    def name(self) -> str:
        """The task's."""
        return self.count.task

    @property
    def typical(self) -> Row | None:
        """The success of median completion time."""
        ordered = sorted(self.count.solved, key=lambda r: (r["completion_time_s"], r["seed"]))
        return ordered[(len(ordered) - 1) // 2] if ordered else None

    @property
    def failure(self) -> Row | None:
        """The first of those failures that ended in the most common way."""
        failures = [row for row in self.count.rows if not row["success"]]
        if not failures:
            return None
        common, _ = Counter(row["end_reason"] for row in failures).most_common(1)[0]
        return next(row for row in failures if row["end_reason"] == common)


@dataclass(frozen=True)
class Results:
    """The folder of a suite.

    Attributes:
        folder: with the journal and the recordings.
        suite: which one.
        request: what was asked for: its command, tasks, number of trials and first seed.
        rows: of all trials of the request that are done.
        tasks: those of which there are trials, in the suite's order.
    """

    folder: Path
    suite: Suite
    request: Mapping[str, Any]
    rows: Sequence[Row]
    tasks: Sequence[TaskResult]

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Read a folder.

        Raises:
            UsageError: no suite was run there, or none of its trials is done.
        """
        try:
            request = json.loads((folder / REQUEST).read_text(encoding="utf-8"))
            suite, tasks = SUITES[request["suite"]], request["tasks"]
            seeds = range(request["seed0"], request["seed0"] + request["trials"])
        except (OSError, ValueError, KeyError, TypeError):
            raise UsageError(
                f"{folder} is not the folder of a suite; `sumo-dist bench suite NAME --out DIR` "
                "makes one"
            ) from None
        asked = {Trial(task, seed, v) for task in tasks for seed in seeds for v in VARIANTS}
        rows = [row for row in read_rows(folder / JOURNAL) if Trial.of(row) in asked]
        rows.sort(key=lambda row: row["seed"])
        counts, controls = count_tasks(rows), count_tasks(rows, STANDING)
        if not counts:
            raise UsageError(f"no trial in {folder / JOURNAL} is done yet")
        results = [
            TaskResult(counts[task], controls.get(task), figure)
            for task, figure in suite.figures.items()
            if task in counts
        ]
        return cls(folder, suite, request, rows, results)

    @property
    def missing(self) -> int:
        """How many trials are not done."""
        tasks = self.request["tasks"]
        wanted = len(tasks) + len({*tasks} & {*self.suite.controls})
        return wanted * self.request["trials"] - len(self.rows)

    @property
    def settings(self) -> dict[str, Any]:
        """The planner's settings and what else decides a trial; the same for all of them."""
        row = self.rows[0]
        limits = sorted({row["time_limit_s"] for row in self.rows})
        return {
            **row["planner"],
            "time_limit": " or ".join(f"{limit:g}" for limit in limits),
            "engine": row["engine"],
            "engine_build": row["engine_build"],
        }

    def made_by(self, key: str) -> list[str]:
        """Return what the trials were made by: codes, machines; see report.provenance."""
        return sorted({row["provenance"][key] for row in self.rows})

    def failures(self) -> list[Row]:
        """Return the trials that did not succeed, task by task."""
        return [row for task in self.tasks for row in task.count.rows if not row["success"]]

    def findings(self) -> list[str]:
        """Say in sentences what is in the tables."""
        counts = [task.count for task in self.tasks]
        successes, trials = (
            sum(getattr(c, key) for c in counts) for key in ("successes", "trials")
        )
        low, high = wilson(successes, trials)
        ours = statistics.mean(count.rate for count in counts)
        published = statistics.mean(task.figure.rate for task in self.tasks)
        reached = sum(task.count.rate >= task.figure.rate for task in self.tasks)
        said = [
            f"{successes} of {trials} trials succeeded (95 % interval {low:.3f} to {high:.3f}). "
            f"The mean of the tasks' rates is {ours:.3f}, published {published:.3f}; "
            f"{reached} of {len(counts)} tasks are at or above what is published."
        ]
        if controls := [task.control for task in self.tasks if task.control]:
            by_itself, of = (sum(getattr(c, k) for c in controls) for k in ("successes", "trials"))
            said.append(f"Without planning, {by_itself} of {of} trials succeeded by themselves.")
        if self.missing:
            said.append(
                f"Unfinished: {self.missing} trials are missing; the command goes on from here."
            )
        return said

    def recording(self, row: Row) -> Path:
        """Folder of a trial's recording, which need not be there."""
        return recording_folder(self.folder / RECORDINGS, Trial.of(row))

    def exemplars(self) -> list[Row]:
        """The typical success and the failure of each task, as far as there are any."""
        pairs = ((result.typical, result.failure) for result in self.tasks)
        return [row for pair in pairs for row in pair if row is not None]


VARIANTS = (PLANNED, STANDING)


def recording_folder(recordings: Path, trial: Trial) -> Path:
    """Where the recording of a trial is."""
    standing = "-standing" if trial.variant == STANDING else ""
    return recordings / f"{trial.task.replace('/', '_')}-{trial.seed}{standing}"
