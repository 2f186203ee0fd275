"""The report's charts, as SVG whose colours are the page's: see page.css."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

from sumo_dist.bench.results.outcomes import Count, Results, TaskResult
from sumo_dist.bench.results.stats import wilson

ROW = 30  # height of a task in a chart [px]
NAMES = 128  # width of the tasks' names [px]
WIDTH = 1060

# Reason -> class of its colour; a task's own reasons take the others in turn.
REASONS = {"success": "good", "timeout": "late", "fell": "fell", "fault": "fault"}
OTHERS = ("other-a", "other-b", "other-c")


class Axis(NamedTuple):
    """A horizontal axis.

    Attributes:
        left, right: its ends [px].
        limit: value at its right end; 0 at its left.
        ticks: values that are labelled.
        unit: written behind each.
    """

    left: float
    right: float
    limit: float
    ticks: Sequence[float]
    unit: str = ""

    def at(self, value: float) -> float:
        """Return where a value is [px]."""
        return round(self.left + (self.right - self.left) * value / self.limit, 1)

    def grid(self, top: float, bottom: float) -> Iterable[str]:
        """Draw lines at the ticks, and their labels below."""
        for tick in self.ticks:
            x = self.at(tick)
            yield f'<line class="grid" x1="{x}" x2="{x}" y1="{top}" y2="{bottom}"/>'
            yield text(x, bottom + 16, f"{tick:g}{self.unit}", "tick middle")


def success_and_time(results: Results) -> str:
    """Success of each task beside what is published, and when its trials were solved."""
    limit = time_limit(results)
    rate = Axis(NAMES + 10, NAMES + 380, 1.0, (0.0, 0.25, 0.5, 0.75, 1.0))
    time = Axis(NAMES + 450, WIDTH - 60, limit, time_ticks(limit), " s")
    rows = list(zip(row_places(results), results.tasks, strict=True))
    top, bottom = 34, rows[-1][0] + ROW / 2 + 4
    parts = [
        text(rate.left, 16, "success rate, 95 % interval", "head"),
        text(time.left, 16, "time of each solved trial, and their median", "head"),
        text(WIDTH - 24, 16, "unsolved", "head middle"),
        *rate.grid(top, bottom),
        *time.grid(top, bottom),
    ]
    for y, task in rows:
        parts += [text(NAMES, y + 4, short(task.name), "name end")]
        parts += [*success_marks(rate, y, task), *time_marks(time, y, task)]
    return svg(WIDTH, bottom + 24, parts)


def success_marks(axis: Axis, y: float, task: TaskResult) -> Iterable[str]:
    """Draw a task's rate, the published one below it, and that of the robot that only stands."""
    figure, count = task.figure, task.count
    yield interval(axis, y + 6, wilson(figure.successes, figure.trials), "paper")
    yield diamond(axis.at(figure.rate), y + 6, f"published: {figure.successes}/{figure.trials}")
    yield interval(axis, y - 4, count.interval, "ours")
    yield circle(axis.at(count.rate), y - 4, 5, "ours", f"{count.successes}/{count.trials}")
    if task.control:
        said = f"standing: {task.control.successes}/{task.control.trials}"
        yield cross(axis.at(task.control.rate), y - 4, "control", said)


def time_marks(axis: Axis, y: float, task: TaskResult) -> Iterable[str]:
    """Draw when each trial was solved, the median, and how many were not."""
    for i, row in enumerate(task.count.rows):
        if row["success"]:
            seconds = row["completion_time_s"]
            aside = (i % 5 - 2) * 2.6  # so that equal times do not hide each other
            said = f"seed {row['seed']}: {seconds:.2f} s"
            yield circle(axis.at(seconds), y + aside, 3.2, "trial", said)
    if (median := task.count.median) is not None:
        x = axis.at(median)
        yield (
            f'<line class="median" x1="{x}" x2="{x}" y1="{y - 11}" y2="{y + 11}">'
            f"<title>median {median:.2f} s</title></line>"
        )
    if unsolved := task.count.trials - task.count.successes:
        yield text(WIDTH - 24, y + 4, str(unsolved), "unsolved middle")


def solved_by(results: Results, task: TaskResult) -> str:
    """Share of trials that are solved by each time, small."""
    limit = time_limit(results)
    axis, top, bottom = Axis(26, 190, limit, time_ticks(limit, 3), " s"), 24, 104
    success, *_ = task.count.cells()
    parts = [
        text(axis.left, 14, short(task.name), "name"),
        text(axis.right, 14, success, "tick end"),
        *axis.grid(top, bottom),
        *(
            f'<line class="grid" x1="{axis.left}" x2="{axis.right}" y1="{y}" y2="{y}"/>'
            for y in (top, (top + bottom) / 2, bottom)
        ),
        *(
            text(axis.left - 5, y + 4, label, "tick end")
            for label, y in (("1", top), ("0", bottom))
        ),
    ]
    if task.control:
        parts.append(steps(axis, top, bottom, task.control, "control"))
    parts.append(steps(axis, top, bottom, task.count, "ours"))
    return svg(200, bottom + 24, parts)


def steps(axis: Axis, top: float, bottom: float, count: Count, look: str) -> str:
    """Draw the empirical distribution of completion times."""
    path = f"M{axis.left} {bottom}"
    for i, seconds in enumerate(sorted(count.times), 1):
        y = round(bottom - (bottom - top) * i / count.trials, 1)
        path += f"H{axis.at(seconds)}V{y}"
    return f'<path class="steps {look}" d="{path}H{axis.right}"/>'


def endings(results: Results) -> str:
    """Draw how the trials of each task ended, as bars of counts."""
    most = max(task.count.trials for task in results.tasks)
    axis = Axis(NAMES + 10, WIDTH - 60, most, ())
    looks = reason_looks(results)
    parts = []
    places = list(row_places(results, 12))
    for y, task in zip(places, results.tasks, strict=True):
        parts.append(text(NAMES, y + 4, short(task.name), "name end"))
        done = 0
        for reason in sorted(task.count.endings, key=list(looks).index):
            n = task.count.endings[reason]
            left, right = axis.at(done), axis.at(done + n)
            parts.append(
                f'<rect class="bar {looks[reason]}" x="{left}" y="{y - 9}" '
                f'width="{right - left - 1.5:.1f}" height="18" rx="2">'
                f"<title>{escape(reason)}: {n}</title></rect>"
            )
            parts.append(text(left + 7, y + 4, str(n), "count"))
            done += n
    return svg(WIDTH, places[-1] + ROW / 2 + 2, parts)


def reason_looks(results: Results) -> dict[str, str]:
    """Every reason that ended a trial -> the class of its colour, success first."""
    found = {reason for task in results.tasks for reason in task.count.endings}
    own = sorted(found - {*REASONS})
    looks = {reason: look for reason, look in REASONS.items() if reason in found}
    return looks | {reason: OTHERS[i % len(OTHERS)] for i, reason in enumerate(own)}


def row_places(results: Results, top: float = 34) -> Iterable[float]:
    """Yield the height of each task's middle; families of tasks stand a little apart."""
    y, before = top - ROW / 2, None
    for task in results.tasks:
        family = task.name.partition("_")[0]
        y += ROW + (8 if before not in (None, family) else 0)
        before = family
        yield y


def time_limit(results: Results) -> float:
    """Return the longest time a trial was given [s]."""
    return max(row["time_limit_s"] for row in results.rows)


def time_ticks(limit: float, parts: int = 6) -> list[float]:
    """Return times to label, in equal parts of the limit [s]."""
    return [limit * i / parts for i in range(parts + 1)]


def short(task: str) -> str:
    """Name a task without its robot."""
    return task.rpartition("/")[2].replace("_", " ")


def svg(width: float, height: float, parts: Iterable[str]) -> str:
    """Put shapes on a canvas that shrinks with the page."""
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" width="{width:g}" role="img">'
        + "".join(parts)
        + "</svg>"
    )


def text(x: float, y: float, content: str, look: str) -> str:
    """Write a label."""
    return f'<text class="{look}" x="{x:g}" y="{y:g}">{escape(content)}</text>'


def circle(x: float, y: float, radius: float, look: str, said: str) -> str:
    """Draw a disc that says something under the pointer."""
    return (
        f'<circle class="{look}" cx="{x:g}" cy="{y:g}" r="{radius:g}">'
        f"<title>{escape(said)}</title></circle>"
    )


def diamond(x: float, y: float, said: str) -> str:
    """Draw a published figure."""
    return (
        f'<path class="paper mark" d="M{x - 4.5:g} {y:g}l4.5 -4.5l4.5 4.5l-4.5 4.5z">'
        f"<title>{escape(said)}</title></path>"
    )


def cross(x: float, y: float, look: str, said: str) -> str:
    """Draw a cross that says something under the pointer."""
    return (
        f'<path class="{look} mark" d="M{x - 4:g} {y - 4:g}l8 8m0 -8l-8 8">'
        f"<title>{escape(said)}</title></path>"
    )


def interval(axis: Axis, y: float, ends: tuple[float, float], look: str) -> str:
    """Draw a line between two values."""
    low, high = map(axis.at, ends)
    return f'<line class="interval {look}" x1="{low}" x2="{high}" y1="{y:g}" y2="{y:g}"/>'
