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
from sumo_dist.view.marks import Color
from sumo_dist.view.outputs import Outputs

SEND_TICKS = 10  # of a line are sent at a time: a chunk of one row is nearly all overhead
BUDGETS = 4.0  # by how many budgets a plan's time is cut off, so that the budget is seen

_COLORS: tuple[Color, ...] = (  # legible on dark and on light
    (66, 146, 214),
    (238, 130, 50),
    (44, 160, 112),
    (204, 96, 160),
    (148, 118, 200),
    (200, 160, 40),
    (214, 70, 70),
    (130, 130, 130),
)
_LIMIT: Color = (150, 150, 150)


@dataclass(frozen=True)
class Plot:
    """One plot.

    Attributes:
        origin: of its entities, below "plots".
        title: over it.
        lines: names, in the legend; empty where each is named by an entity of its own.
        limits: how many of the lines, from the last one on, are limits.
        beside: it is beside the plot before it, not below.
    """

    origin: str
    title: str
    lines: tuple[str, ...] = ()
    limits: int = 0
    beside: bool = False


def plots(task: Task, distributed: bool) -> tuple[Plot, ...]:
    """Return the plots of a task, its progress first; with workers, theirs last."""
    shown = [
        *_progress_plots(task),
        Plot("cost", "Cost of the candidates (peaks cut)", ("current plan", "best", "median")),
        Plot("terms", "Cost of the current plan", tuple(term.name for term in task.cost)),
        Plot(
            "timing",
            f"Planning [ms] (cut at {BUDGETS:.0f} budgets)",
            ("plan time", "age of state", "budget"),
            limits=1,
        ),
    ]
    if distributed:
        shown.append(Plot("workers", "Rollout workers", ("alive", "lost rollouts", "sent twice")))
        shown.append(Plot("pace", "Rollouts per second", beside=True))
    return tuple(shown)


def _progress_plots(task: Task) -> list[Plot]:
    if not isinstance(task.success, AllBelow):
        has = Plot("progress/success", "Success test", ("1: it holds",))
        mover = "robot" if task.goal_frame == "base" else task.goal_frame
        line = f"{mover} to goal"
        away = Plot("progress/goal", f"{line.capitalize()} [m]", (line,))
        return [has] if task.goal is None else [away, has]
    shown = []
    for i, measure in enumerate(task.success.measures):
        unit = task.table.parameters[measure.limit].unit
        title = f"{measure.name[:1].upper()}{measure.name[1:]} [{unit}]" if unit else measure.name
        shown.append(Plot(f"progress/{i}", title, (measure.name, "solved below"), limits=1))
    return shown


@dataclass
class _Rows:
    ticks: list[int] = field(default_factory=list)
    values: list[Sequence[float] | np.ndarray] = field(default_factory=list)


class PlotLog:
    """Writes the plots' values."""

    def __init__(self, out: Outputs, task: Task, distributed: bool) -> None:
        """Name the lines."""
        self._out, self._task = out, task
        self._rows: dict[str, _Rows] = {}
        self._indicators = np.array([term.reduction in INDICATORS for term in task.cost])
        self._cost_ceiling = self._term_ceiling = -np.inf
        for plot in plots(task, distributed):
            if plot.lines:
                colors = [*_COLORS[: len(plot.lines) - plot.limits], *[_LIMIT] * plot.limits]
                names = rr.SeriesLines(names=plot.lines, colors=colors[: len(plot.lines)])
                out.log(f"plots/{plot.origin}", names)

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
        age_ms = report.age_ticks * TICK * 1e3
        self.add(
            "timing", tick, [*np.minimum([report.plan_ms, age_ms], BUDGETS * budget_ms), budget_ms]
        )

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
