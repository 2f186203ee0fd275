"""The paper's methods side by side: what they solved there, and what they solve here."""

import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.outcomes import Count, Row
from sumo_dist.bench.results.stats import wilson
from sumo_dist.bench.results.suites import PAPER_ANALYSIS

OBJECTS = ("box", "chair", "cone", "tire", "rack")  # in the order of the published rates
MOVE, UPRIGHT = "move", "upright"
HEAD = (
    *("task", "method", "success", "rate", "Wilson 95 %", "paper"),
    *("mean [s]", "CPU per trial [s]", "ended by"),
)
TRAINED_HEAD = (
    *("method", "trained on", "seed", "updates", "actions", "robot time [h]"),
    *("wall [h]", "CPU [h]", "code", "machine"),
)
NOTES = (
    "Success rates, the paper's in brackets (arXiv:2604.08508, Fig. 4 and 5; there, end-to-end MPC "
    "was run for Move only). A learned policy does all objects with what it has learned on one; "
    "the paper's rates are those of policies trained on the box.",
    "Mean times are those of the successes. CPU time of a trial is that of all threads, the "
    "simulated robot included, and nothing of the training.",
)


@dataclass(frozen=True)
class Method:
    """One way to control the robot.

    Attributes:
        name: on the command line, and of its journal.
        title: in tables and pictures.
        published: success rates of OBJECTS in the paper, by family.
        prefix: of its tasks' names behind the robot's; those of joint targets have one.
        learned: a policy drives, from a file.
        per_task: published rates of Move where it was trained on each object by itself.
    """

    name: str
    title: str
    published: Mapping[str, tuple[float, ...]]
    prefix: str = ""
    learned: bool = False
    per_task: tuple[float, ...] = ()

    def task(self, family: str, thing: str) -> str:
        """Name the task of a family with an object."""
        return f"spot/{self.prefix}{family}_{thing}"


METHODS = {
    method.name: method
    for method in (
        Method(
            "sumo",
            "Sumo",
            {
                family: tuple(
                    PAPER_ANALYSIS.figures[f"spot/{family}_{thing}"].rate for thing in OBJECTS
                )
                for family in (MOVE, UPRIGHT)
            },
        ),
        Method("e2e-mpc", "end-to-end MPC", {MOVE: (0.0, 0.3, 0.1, 0.5, 0.3)}, "joints_"),
        Method(
            "e2e-rl",
            "end-to-end RL",
            {MOVE: (1.0, 0.4, 0.62, 0.2, 0.1), UPRIGHT: (0.04, 0.14, 0.04, 0.16, 0.02)},
            "joints_",
            learned=True,
            per_task=(0.98, 1.0, 1.0, 0.16, 0.0),
        ),
        Method(
            "hrl",
            "hierarchical RL",
            {MOVE: (0.96, 0.56, 0.0, 0.0, 0.02), UPRIGHT: (0.0, 0.18, 0.14, 0.02, 0.16)},
            learned=True,
        ),
    )
}


@dataclass(frozen=True)
class Outcome:
    """What a method did.

    Attributes:
        method: which.
        counts: of its trials, by family and object.
        origin: of its learned policy, see `planner.learned.Contract`.
    """

    method: Method
    counts: Mapping[tuple[str, str], Count]
    origin: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, method: Method, rows: Sequence[Row], origin: Mapping[str, Any]) -> "Outcome":
        """Sort the rows of a method's trials."""
        counts = {}
        for family in method.published:
            for thing in OBJECTS:
                task = method.task(family, thing)
                if of_it := [row for row in rows if row["task"] == task]:
                    counts[family, thing] = Count(task, of_it)
        return cls(method, counts, origin)

    def published(self, family: str, thing: str) -> float:
        """The paper's rate."""
        return self.method.published[family][OBJECTS.index(thing)]


def text(outcomes: Sequence[Outcome], command: str, picture: str) -> str:
    """Lay out the page.

    Args:
        outcomes: of the methods, in the order of the tables.
        command: that made them.
        picture: name of the picture's file beside the page.
    """
    rows = [row for found in outcomes for count in found.counts.values() for row in count.rows]
    made_by = "; ".join(sorted({row["provenance"]["sumo_dist"] for row in rows}))
    machines = "; ".join(sorted({row["provenance"]["machine"] for row in rows}))
    parts = [
        "# The paper's methods, side by side",
        f"`{command}`",
        f"sumo-dist {made_by}; {machines}.",
        f"![success of each method]({picture})",
    ]
    for family in (MOVE, UPRIGHT):
        lines = [*_rates(outcomes, family)]
        if lines:
            parts.append(markdown((family.capitalize(), *OBJECTS), lines))
    parts += [*NOTES, "## Trials", markdown(HEAD, [*_trials(outcomes)])]
    if trained := [*_trainings(outcomes)]:
        parts += ["## Training", markdown(TRAINED_HEAD, trained)]
    return "\n\n".join(parts) + "\n"


def listing(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """Return what is in the tables, as JSON has it."""
    return [
        {
            "method": found.method.name,
            "task": count.task,
            "trials": count.trials,
            "successes": count.successes,
            "interval": wilson(count.successes, count.trials),
            "published_rate": found.published(family, thing),
            "mean_time_s": statistics.mean(count.times) if count.times else None,
            "mean_cpu_s": _cpu_s(count),
            "seeds": sorted(row["seed"] for row in count.rows),
            "endings": dict(count.endings),
            "policy": dict(found.origin),
        }
        for found in outcomes
        for (family, thing), count in found.counts.items()
    ]


def _rates(outcomes: Iterable[Outcome], family: str) -> Iterator[tuple[str, ...]]:
    """One line a method: of each object our rate and the paper's."""
    for found in outcomes:
        if not any(family == of for of, _ in found.counts):
            continue
        counts = [found.counts.get((family, thing)) for thing in OBJECTS]
        ours = ["-" if count is None else f"{count.rate:.2f}" for count in counts]
        pairs = zip(ours, found.method.published[family], strict=True)
        yield found.method.title, *(f"{here} ({there:.2f})" for here, there in pairs)
        if family == MOVE and found.method.per_task:
            alone = (f"({rate:.2f})" for rate in found.method.per_task)
            yield f"{found.method.title}, trained on each", *alone


def _trials(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, ...]]:
    """One line a task and method."""
    for family in (MOVE, UPRIGHT):
        for thing in OBJECTS:
            for found in outcomes:
                if count := found.counts.get((family, thing)):
                    success, rate, interval, _, mean = count.cells()
                    paper, cpu = f"{found.published(family, thing):.2f}", f"{_cpu_s(count):.1f}"
                    how = success, rate, interval, paper, mean, cpu, count.ended_by()
                    yield f"{family} {thing}", found.method.title, *how


def _trainings(outcomes: Iterable[Outcome]) -> Iterator[tuple[str, ...]]:
    """One line a learned policy."""
    for found in outcomes:
        if found.method.learned:
            origin = found.origin
            request = origin.get("trained", {})
            about = (request.get("task"), request.get("seed"), origin.get("updates"))
            done = (origin.get("actions"), origin.get("robot_hours"))
            hours = (_hours(origin.get(name)) for name in ("wall_s", "cpu_s"))
            where = (origin.get("sumo_dist"), origin.get("machine"))
            cells = (*about, *done, *hours, *where)
            yield found.method.title, *("-" if c is None else str(c) for c in cells)


def _hours(seconds: float | None) -> str | None:
    return None if seconds is None else f"{seconds / 3600:.2f}"


def _cpu_s(count: Count) -> float:
    """Mean CPU time of a trial [s]."""
    return statistics.mean(row["cpu_s"] for row in count.rows)
