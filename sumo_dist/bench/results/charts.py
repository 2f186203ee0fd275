"""The report's charts: SVG by Matplotlib, whose colours the page sets, for light and dark."""

import io
from collections.abc import Sequence
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sumo_dist.bench.results.outcomes import Count, Results
from sumo_dist.bench.results.stats import wilson

# Names of the page's colours, see page.css. Charts are drawn in stand-ins, which these replace.
NAMES = (
    *("ink", "soft", "line", "paper", "ours", "published", "control"),
    *("good", "late", "fell", "fault", "other-a", "other-b", "other-c"),
)
COLOURS = {f"#0000{number:02x}": name for number, name in enumerate(NAMES, 1)}
INK, SOFT, LINE, PAPER, OURS, PUBLISHED, CONTROL, GOOD, LATE, FELL, FAULT, *OTHERS = COLOURS
REASONS = {"success": GOOD, "timeout": LATE, "fell": FELL, "fault": FAULT}
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "sumo-dist",  # equal results make equal files
    **dict.fromkeys(("font.size", "axes.titlesize"), 9),
    **dict.fromkeys(("text.color", "ytick.labelcolor"), INK),
    **dict.fromkeys(("axes.edgecolor", "grid.color", "xtick.color", "ytick.color"), LINE),
    **dict.fromkeys(("axes.titlecolor", "xtick.labelcolor", "legend.labelcolor"), SOFT),
    **dict.fromkeys((f"axes.spines.{side}" for side in ("top", "right", "left")), False),
    **dict.fromkeys(("ytick.left", "legend.frameon"), False),
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.grid.axis": "x",
}
WIDTH, ROW = 11.0, 0.33  # of a chart, and the height of a task in it [inch]


def success_and_time(results: Results) -> str:
    """Success of each task beside what is published, and when its trials were solved."""
    with rc_context(STYLE):
        figure = Figure((WIDTH, 1.0 + ROW * len(results.tasks)), layout="constrained")
        rates, times = figure.subplots(
            1, 2, sharey=True, width_ratios=(4, 5), gridspec_kw={"wspace": 0.08}
        )
        _draw_rates(rates, results)
        _draw_times(times, results)
        rates.set_yticks(*_task_ticks(results))
        rates.set_ylim(len(results.tasks) - 0.4, -0.6)
        figure.legend(loc="outside upper left", ncols=3)
        return _svg(figure)


def _draw_rates(axes: Axes, results: Results) -> None:
    """Rates with their intervals, the published ones below, and those of a robot that stands."""
    axes.set(title="success rate, 95 % interval", xlim=(-0.02, 1.03))
    places = range(len(results.tasks))
    above, below = [y - 0.12 for y in places], [y + 0.18 for y in places]
    ours = [(task.count.successes, task.count.trials) for task in results.tasks]
    _draw_counts(axes, above, ours, OURS, fmt="o", label="here", markersize=6)
    published = [(task.figure.successes, task.figure.trials) for task in results.tasks]
    hollow = {"markerfacecolor": PAPER, "markersize": 5}
    _draw_counts(axes, below, published, PUBLISHED, fmt="D", label="published", **hollow)
    stood = [
        (y, task.control.rate) for y, task in zip(above, results.tasks, strict=True) if task.control
    ]
    if stood:
        cross = {"color": CONTROL, "markersize": 6, "markeredgewidth": 2}
        ys, rates = zip(*stood, strict=True)
        axes.plot(rates, ys, "x", label="the robot only stands", **cross)


def _draw_counts(
    axes: Axes,
    places: Sequence[float],
    counts: Sequence[tuple[int, int]],
    colour: str,
    fmt: str,
    **look: Any,
) -> None:
    """Draw the rates of successes among trials, with their intervals."""
    lows, highs = zip(*(wilson(*count) for count in counts), strict=True)
    axes.hlines(places, lows, highs, color=colour, alpha=0.4, linewidth=2.2)
    axes.plot([successes / n for successes, n in counts], places, fmt, color=colour, **look)


def _draw_times(axes: Axes, results: Results) -> None:
    """When each trial was solved, the median, and how many were not."""
    limit = time_limit(results)
    axes.set(title="time of each solved trial, and their median [s]", xlim=(0.0, limit))
    for y, task in enumerate(results.tasks):
        aside = [y + (i % 5 - 2) * 0.08 for i in range(len(task.count.times))]  # equal times show
        look = {"color": OURS, "alpha": 0.45, "markersize": 4.5}
        axes.plot(task.count.times, aside, "o", gid=f"times of {task.name}", **look)
        if task.count.median is not None:
            axes.vlines(task.count.median, y - 0.36, y + 0.36, color=OURS, linewidth=2.5)
        if unsolved := task.count.trials - task.count.successes:
            label = axes.text(1.03 * limit, y, f"{unsolved} unsolved", color=FELL, weight="bold")
            label.set_verticalalignment("center")


def solved_by(results: Results) -> str:
    """Share of all trials of each task that are solved by each time, one small chart a task."""
    columns = 5
    rows = -(-len(results.tasks) // columns)
    with rc_context({**STYLE, "axes.grid.axis": "both"}):
        figure = Figure((WIDTH, 0.2 + 1.7 * rows), layout="constrained")
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        limit = time_limit(results)
        for axes in grid.flat[len(results.tasks) :]:
            axes.set_axis_off()
        for axes, task in zip(grid.flat, results.tasks, strict=False):
            axes.set(xlim=(0, limit), ylim=(-0.02, 1.04), yticks=(0, 0.5, 1))
            axes.set_title(f"{short(task.name)}  {task.count}")
            if task.control:
                _draw_steps(axes, task.control, limit, color=CONTROL, linestyle="--")
            _draw_steps(axes, task.count, limit, color=OURS)
        figure.supxlabel("time [s]", color=SOFT, fontsize=9)
        return _svg(figure)


def _draw_steps(axes: Axes, count: Count, limit: float, **look: Any) -> None:
    """The empirical distribution of completion times."""
    times = [0.0, *sorted(count.times), limit]
    solved = [*range(count.successes + 1), count.successes]
    axes.step(times, [n / count.trials for n in solved], where="post", linewidth=2, **look)


def endings(results: Results) -> str:
    """How the trials of each task ended, as bars of counts."""
    with rc_context({**STYLE, "axes.grid": False, "axes.spines.bottom": False}):
        figure = Figure((WIDTH, 0.6 + ROW * len(results.tasks)), layout="constrained")
        axes, done = figure.subplots(), [0] * len(results.tasks)
        for reason, colour in reason_colours(results).items():
            counts = [task.count.endings[reason] for task in results.tasks]
            bars = axes.barh(
                range(len(counts)), counts, 0.66, done, color=colour, edgecolor=PAPER, label=reason
            )
            axes.bar_label(bars, [n or "" for n in counts], label_type="center", color=PAPER)
            done = [left + n for left, n in zip(done, counts, strict=True)]
        axes.set(xticks=(), ylim=(len(done) - 0.4, -0.6), xlim=(0, max(done)))
        axes.set_yticks(*_task_ticks(results))
        figure.legend(loc="outside upper left", ncols=len(REASONS) + len(OTHERS))
        return _svg(figure)


def reason_colours(results: Results) -> dict[str, str]:
    """Every reason that ended a trial -> its colour, success first, a task's own reasons last."""
    found = {reason for task in results.tasks for reason in task.count.endings}
    own = sorted(found - {*REASONS})
    colours = {reason: colour for reason, colour in REASONS.items() if reason in found}
    return colours | {reason: OTHERS[i % len(OTHERS)] for i, reason in enumerate(own)}


def time_limit(results: Results) -> float:
    """Return the longest time a trial was given [s]."""
    return max(row["time_limit_s"] for row in results.rows)


def short(task: str) -> str:
    """Name a task without its robot."""
    return task.rpartition("/")[2].replace("_", " ")


def _task_ticks(results: Results) -> tuple[Sequence[int], list[str]]:
    return range(len(results.tasks)), [short(task.name) for task in results.tasks]


def _svg(figure: Figure) -> str:
    """Return a figure as an SVG element whose colours are the page's."""
    file = io.StringIO()
    figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    _, start, svg = file.getvalue().partition("<svg")  # without the head of an XML file
    for drawn, name in COLOURS.items():
        svg = svg.replace(drawn, f"var(--{name})")
    return start + svg
