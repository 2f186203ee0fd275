"""What a campaign found: counts of each task, and the folder of a suite."""

import json
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from sumo_dist.bench.results.journal import PLANNED, STANDING, Trial, read_rows
from sumo_dist.bench.results.stats import wilson
from sumo_dist.bench.results.suites import SUITES, Figure, Suite
from sumo_dist.episode.motion import mean
from sumo_dist.errors import UsageError

JOURNAL = "trials.jsonl"
REQUEST = "suite.json"
RECORDINGS = "recordings"
CELLS = ("success", "rate", "Wilson 95 %", "median [s]", "mean [s]")

Row = Mapping[str, Any]


class Count:
    """Counts of some trials.

    Attributes:
        task: their task's name.
        rows: of the journal.
        solved: those of the successes.
        trials, successes: how many there are.
        times: completion times of the successes [s].
        median: of these times, None without any [s].
        rate: share of successes.
        interval: Wilson's 95 % interval of the rate.
        endings: how many trials ended for which reason; faults are one.
    """

    def __init__(self, task: str, rows: Iterable[Row]) -> None:
        """Count."""
        self.task, self.rows = task, list(rows)
        self.solved = [row for row in self.rows if row["success"]]
        self.trials, self.successes = len(self.rows), len(self.solved)
        self.times: list[float] = [row["completion_time_s"] for row in self.solved]
        self.median = statistics.median(self.times) if self.times else None
        self.rate = self.successes / self.trials
        self.interval = wilson(self.successes, self.trials)
        self.endings = Counter(row["end_reason"].partition(":")[0] for row in self.rows)

    def __str__(self) -> str:
        """Say it in a table: successes of trials."""
        return f"{self.successes}/{self.trials}"

    @property
    def motion(self) -> dict[str, float]:
        """Means of how the robot moved, see episode.motion; journals of old have none."""
        return mean(row.get("motion", {}) for row in self.rows)

    def cells(self) -> tuple[str, ...]:
        """Return the cells under CELLS."""
        low, high = self.interval
        median = "-" if self.median is None else f"{self.median:.2f}"
        mean = f"{statistics.mean(self.times):.2f}" if self.times else "-"
        return str(self), f"{self.rate:.2f}", f"{low:.2f} to {high:.2f}", median, mean

    def ended_by(self) -> str:
        """Name the reasons and how often each was."""
        return ", ".join(f"{reason} {n}" for reason, n in self.endings.items())


def count_tasks(rows: Iterable[Row], variant: str = PLANNED) -> dict[str, Count]:
    """Sort rows by task, in the order in which tasks first come."""
    tasks: dict[str, list[Row]] = {}
    for row in rows:
        if row["variant"] == variant:
            tasks.setdefault(row["task"], []).append(row)
    return {task: Count(task, of_it) for task, of_it in tasks.items()}


@dataclass(frozen=True)
class TaskResult:
    """One task of a suite."""

    count: Count
    control: Count | None  # of the trials in which the robot only stands, if there are any
    figure: Figure  # what has been published

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
    def failures(self) -> list[Row]:
        """The trials that did not succeed."""
        return [row for row in self.count.rows if not row["success"]]

    @property
    def failure(self) -> Row | None:
        """The first of those failures that ended in the most common way."""
        reasons = Counter(row["end_reason"] for row in self.failures)
        most = max(reasons.values(), default=0)
        return next((row for row in self.failures if reasons[row["end_reason"]] == most), None)


@dataclass(frozen=True)
class Results:
    """The folder of a suite."""

    folder: Path
    suite: Suite
    request: Mapping[str, Any]  # what was asked for: command, tasks, number of trials, first seed
    rows: Sequence[Row]  # of all trials of the request that are done
    tasks: Sequence[TaskResult]  # those of which there are trials, in the suite's order

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
        rows = [
            row
            for row in read_rows(folder / JOURNAL)
            if row["task"] in tasks and row["seed"] in seeds
        ]
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
        tasks = {*self.request["tasks"]}
        wanted = len(tasks) + len(tasks & {*self.suite.controls})
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
        """Return what the trials were made by: codes, machines; see `provenance`."""
        return sorted({row["provenance"][key] for row in self.rows})

    def failures(self) -> list[Row]:
        """Return the trials that did not succeed, task by task."""
        return [row for task in self.tasks for row in task.failures]

    def findings(self) -> list[str]:
        """Say in sentences what is in the tables."""
        total = Count("all", [row for task in self.tasks for row in task.count.rows])
        low, high = total.interval
        ours = statistics.mean(task.count.rate for task in self.tasks)
        published = statistics.mean(task.figure.rate for task in self.tasks)
        reached = sum(task.count.rate >= task.figure.rate for task in self.tasks)
        said = [
            f"{total.successes} of {total.trials} trials succeeded (95 % interval {low:.3f} to "
            f"{high:.3f}). The mean of the tasks' rates is {ours:.3f}, published {published:.3f}; "
            f"{reached} of {len(self.tasks)} tasks are at or above what is published."
        ]
        if stood := [row for task in self.tasks if task.control for row in task.control.rows]:
            by_itself = sum(row["success"] for row in stood)
            said.append(
                f"Without planning, {by_itself} of {len(stood)} trials succeeded by themselves."
            )
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
        pairs = ((task.typical, task.failure) for task in self.tasks)
        return [row for pair in pairs for row in pair if row is not None]


def recording_folder(recordings: Path, trial: Trial) -> Path:
    """Where the recording of a trial is."""
    standing = "-standing" if trial.variant == STANDING else ""
    return recordings / f"{trial.task.replace('/', '_')}-{trial.seed}{standing}"
