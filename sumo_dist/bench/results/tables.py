"""A suite's results as Markdown."""

from collections.abc import Iterable, Mapping

from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.outcomes import CELLS, Results, Row, TaskResult
from sumo_dist.episode.motion import MEASURES

TABLE_HEAD = ("task", *CELLS[:3], "published", "standing", *CELLS[3:], "ended by")
MOTION_HEAD = ("task", *(measure.title for measure in MEASURES.values()))
FAILURE_HEAD = ("task", "seed", "ended by", "at [s]", "object to goal [m]", "last plan's costs")
MOTION_NOTE = (
    "Means over trials. Reversals are changes of a target's direction, per dimension; jerk is the "
    "root mean square; depths are the deepest of a trial."
)


def text(results: Results) -> str:
    """Lay out the report."""
    made_by = "; ".join(results.made_by("sumo_dist"))
    parts = [
        f"# {results.suite.title}",
        f"`{results.request['command']}`",
        f"sumo-dist {made_by}; {'; '.join(results.made_by('machine'))}.",
        *results.findings(),
        table(results),
        f"Published: {results.suite.source}. Standing: nobody plans and the robot only stands.",
    ]
    if lines := [*motion_lines(results.tasks)]:
        parts += ["## Motion", MOTION_NOTE, markdown(MOTION_HEAD, lines)]
    if failures := results.failures():
        parts += ["## Trials that failed", markdown(FAILURE_HEAD, list(failure_lines(failures)))]
    settings = ", ".join(f"{key} {value}" for key, value in results.settings.items())
    return "\n\n".join([*parts, "## Settings", f"{settings}."]) + "\n"


def table(results: Results) -> str:
    """Lay out the counts beside what has been published."""
    return markdown(TABLE_HEAD, [table_line(task) for task in results.tasks])


def table_line(task: TaskResult) -> tuple[str, ...]:
    """Return a task's cells."""
    success, rate, interval, *times = task.count.cells()
    published = str(task.figure)
    standing = f"{task.control.successes}/{task.control.trials}" if task.control else "-"
    return task.name, success, rate, interval, published, standing, *times, task.count.ended_by()


def motion_lines(tasks: Iterable[TaskResult]) -> Iterable[tuple[str, ...]]:
    """One line a task of which any trial's motion was measured."""
    for task in tasks:
        if motion := task.count.motion:
            yield (task.name, *motion_cells(motion))


def motion_cells(motion: Mapping[str, float]) -> list[str]:
    """Return the cells under MOTION_HEAD but for the first."""
    return [
        measure.form.format(motion[name]) if name in motion else "-"
        for name, measure in MEASURES.items()
    ]


def failure_lines(rows: Iterable[Row]) -> Iterable[tuple[str, ...]]:
    """One line a trial."""
    for row in rows:
        distance = row["final_goal_distance_m"]
        yield (
            row["task"],
            str(row["seed"]),
            row["end_reason"],
            f"{row['robot_time_s']:.2f}",
            "-" if distance is None else f"{distance:.2f}",
            ", ".join(f"{name} {cost:.2f}" for name, cost in row["final_costs"].items()) or "-",
        )
