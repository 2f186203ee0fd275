"""What is plotted beside the scene: the lines of each plot, and their values in columns."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr

from sumo_dist.costs.terms import INDICATORS
from sumo_dist.costs.view import View
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks.success import AllBelow
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK
from sumo_dist.view.marks import Color, line_color
from sumo_dist.view.outputs import Outputs

SEND_TICKS = 10  # of a line are sent at a time: a chunk of one row is nearly all overhead
BUDGETS = 4.0  # by how many budgets a plan's time is cut off, so that the budget is seen
LEAD_TICKS = 12  # after which it is looked at how far off a plan was

_LIMIT: Color = (150, 150, 150)


@dataclass(frozen=True)
class Plot:
    """One plot.

    Attributes:
        origin: of its entities, below "plots".
        title: over it.
        lines: names of its lines.
        limits: how many of the lines, from the last one on, are limits, in grey.
        legend: the lines' names are in the plot; else only hovering tells.
    """

    origin: str
    title: str
    lines: tuple[str, ...]
    limits: int = 0
    legend: bool = True


AGE = Plot("age", "Plan's age [ms]", ("age", "late"), 1, legend=False)
COST = Plot("cost", "Cost of the candidates (peaks cut)", ("current plan", "best", "median"))
TIMING = Plot(
    "timing",
    "A plan takes [ms]",
    ("plan time", "optimizer's own", "budget"),
    limits=1,
)
ROLLOUTS = Plot("rollouts", "Rollouts of a plan", ("in time", "sent twice", "asked"), limits=1)
WORKERS = Plot("workers", "Workers", ("that answer", "alive"), limits=1)
PACE = Plot("pace", "Rollouts per second of a worker", ("fastest", "median", "slowest"))
DROPPED = Plot("dropped", "Messages lost so far", ("robot, optimizer", "workers", "this view"))
FLEET = (TIMING, ROLLOUTS, PACE, WORKERS, DROPPED)


@dataclass(frozen=True)
class Plots:
    """The plots of a task, by what they are looked at for.

    Attributes:
        progress: towards the task's goal, against what solves it.
        tune: what the cost and the plans are like.
        fleet: who computes how much; empty in one process.
    """

    progress: tuple[Plot, ...]
    tune: tuple[Plot, ...]
    fleet: tuple[Plot, ...]

    @property
    def all(self) -> tuple[Plot, ...]:
        """Every plot."""
        return (*self.progress, AGE, *self.tune, *self.fleet)


def plots(task: Task, distributed: bool, forces: Sequence[str]) -> Plots:
    """Return the plots of a task between whose bodies there are some forces."""
    off = tuple(name.replace("_", " ") for name in compared(task))
    tune = (
        Plot("terms", "Cost over time (colours as left)", _terms(task), legend=False),
        COST,
        Plot("off", f"Off the plan after {LEAD_TICKS * TICK:g} s [m]", off),
        Plot("forces", "Contact forces of the plan [N]", tuple(forces)),
    )
    return Plots(_progress_plots(task), tune, FLEET if distributed else ())


def compared(task: Task) -> tuple[str, ...]:
    """Frames whose way is compared with the plan."""
    return tuple(dict.fromkeys(("base", *task.trails, *task.movers)))


def _terms(task: Task) -> tuple[str, ...]:
    return tuple(term.name for term in task.cost)


def _progress_plots(task: Task) -> tuple[Plot, ...]:
    if not isinstance(task.success, AllBelow):
        has = Plot("progress/success", "Success test: 1", ("holds",), legend=False)
        mover = "robot" if task.goal_frame == "base" else task.goal_frame
        line = f"{mover} to goal"
        away = Plot("progress/goal", f"{line.capitalize()} [m]", (line,), legend=False)
        return (has,) if task.goal is None else (away, has)
    shown = []
    for i, measure in enumerate(task.success.measures):
        unit = task.table.parameters[measure.limit].unit
        title = f"{measure.name[:1].upper()}{measure.name[1:]}{f' [{unit}]' if unit else ''}"
        lines = (measure.name, "solved below")
        plot = Plot(f"progress/{i}", title, lines, 1, legend=False)
        shown.append(plot)
    return tuple(shown)


@dataclass
class _Rows:
    ticks: list[int] = field(default_factory=list)
    values: list[Sequence[float] | np.ndarray] = field(default_factory=list)


class PlotLog:
    """Writes the plots' values."""

    def __init__(self, out: Outputs, task: Task, shown: Plots) -> None:
        """Name the lines."""
        self._out, self._task = out, task
        self._rows: dict[str, _Rows] = {}
        self._indicators = np.array([term.reduction in INDICATORS for term in task.cost])
        self._cost_ceiling = self._term_ceiling = -np.inf
        for plot in shown.all:
            values = len(plot.lines) - plot.limits
            colors = [*map(line_color, range(values)), *[_LIMIT] * plot.limits]
            out.log(f"plots/{plot.origin}", rr.SeriesLines(names=plot.lines, colors=colors))

    def add_state(self, tick: int, view: View, goal: np.ndarray | None) -> None:
        """Take a tick's progress; the goal (3,) is where it is now."""
        success = self._task.success
        if isinstance(success, AllBelow):
            for i, measure in enumerate(success.measures):
                values = [float(measure.value(view)[0, 0]), measure.allowed(view.p)]
                self.add(f"progress/{i}", tick, values)
            return
        self.add("progress/success", tick, [float(success(view)[0, 0])])
        if goal is not None:
            away = np.linalg.norm(view[self._task.goal_frame].pos[0, 0] - goal)
            self.add("progress/goal", tick, [float(away)])

    def add_plan(self, report: PlanReport, budget_ms: float) -> None:
        """Take a plan's costs, terms and timing."""
        tick = report.plan.tick
        self.add("cost", tick, self._costs(report))
        if report.finite[0]:
            self.add("terms", tick, self._terms(report.terms))
        took = np.minimum([report.plan_ms, report.own_ms], BUDGETS * budget_ms)
        self.add("timing", tick, [*took, budget_ms])
        asked = len(report.costs)
        self.add("rollouts", tick, [asked - report.lost, report.reissued, asked])

    def add_age(self, tick: int, age_ms: float, late_ms: float) -> None:
        """Take the age of the plan that the robot has at a tick, and the one at which it is late.

        Both are robot time.
        """
        self.add("age", tick, [min(age_ms, BUDGETS * late_ms), late_ms])

    def add(self, origin: str, tick: int, values: Sequence[float] | np.ndarray) -> None:
        """Take a row of a plot's lines."""
        rows = self._rows.setdefault(origin, _Rows())
        rows.ticks.append(tick)
        rows.values.append(values)
        if tick - rows.ticks[0] >= SEND_TICKS:
            self._send(origin)

    def flush(self) -> None:
        """Send all rows at hand."""
        for origin in list(self._rows):
            self._send(origin)

    def _send(self, origin: str) -> None:
        rows = self._rows.pop(origin)
        lengths = [len(values) for values in rows.values]
        scalars = rr.Scalars.columns(scalars=np.concatenate(rows.values)).partition(lengths)
        self._out.send(f"plots/{origin}", rows.ticks, scalars)

    def _costs(self, report: PlanReport) -> np.ndarray:
        """Cost of the current plan, the best candidate and the median one, peaks cut off.

        One candidate that falls costs 2500: no line may hide the others. The ceiling is well above
        what a quarter of some plan's candidates were below.
        """
        costs = report.costs[report.finite]
        if not len(costs):
            return np.full(3, np.nan)
        best, quarter, median = np.quantile(costs, [0.0, 0.25, 0.5])
        reach = quarter + max(3.0 * (quarter - best), 0.5 * abs(quarter))
        self._cost_ceiling = max(self._cost_ceiling, reach)
        current = report.costs[0] if report.finite[0] else np.nan
        return np.minimum([current, best, median], self._cost_ceiling)

    def _terms(self, terms: np.ndarray) -> np.ndarray:
        """Terms (n_terms,), of which indicators reach a little above the largest other one."""
        others = np.abs(terms[~self._indicators])
        self._term_ceiling = max(self._term_ceiling, 1.2 * others.max(initial=0.0))
        if not self._term_ceiling:
            return terms
        return np.where(self._indicators, np.minimum(terms, self._term_ceiling), terms)
