"""Campaigns of different planner settings side by side: success, CPU time and motion of each."""

from collections.abc import Callable, Iterator, Mapping, Sequence

from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.cost import HEAD as COST_HEAD
from sumo_dist.bench.results.cost import NOTE as COST_NOTE
from sumo_dist.bench.results.cost import Cost, cost_cells
from sumo_dist.bench.results.outcomes import CELLS, Count, Row
from sumo_dist.episode.motion import MEASURES

MOTION = ("limb_reversals_hz", "target_jerk", "limb_jerk", "joint_jerk")
HEAD = ("cell", *CELLS, *COST_HEAD, *(MEASURES[name].title for name in MOTION), "ended by")
MADE = ("sumo_dist", "mujoco", "machine")
MOTION_NOTE = "Reversals and jerk are means over trials."

Found = Mapping[str, Sequence[Row]]  # name of a cell -> rows of its trials


def text(found: Found, settings: Mapping[str, str], by_task: bool) -> str:
    """Lay out a table of all tasks, one of each robot if there are more, and what they say.

    Args:
        found: what is compared.
        settings: of each cell, in words.
        by_task: one table of each task as well.
    """
    tables = [f"## {title}\n\n{table(rows)}" for title, rows in _groups(found, by_task)]
    cells = "\n".join(f"- {name}: {settings[name]}" for name in found)
    made = {
        tuple(row["provenance"][key] for key in MADE) for rows in found.values() for row in rows
    }
    by = "; ".join(f"sumo-dist {code}, MuJoCo {mujoco}, {on}" for code, mujoco, on in sorted(made))
    return "\n\n".join((*tables, f"{COST_NOTE} {MOTION_NOTE}", cells, f"{by}."))


def table(found: Found) -> str:
    """Lay out one line a cell."""
    return markdown(HEAD, [_line(name, rows) for name, rows in found.items() if rows])


def _groups(found: Found, by_task: bool) -> Iterator[tuple[str, Found]]:
    """Titles of the tables, and what is in them."""
    tasks, robots = (
        list(dict.fromkeys(row[key] for rows in found.values() for row in rows))
        for key in ("task", "robot")
    )
    if len(tasks) > 1:
        yield "all tasks", found
    if len(robots) > 1:
        for robot in robots:
            yield robot, _of(found, lambda row, robot=robot: row["robot"] == robot)
    if by_task or len(tasks) == 1:
        for task in tasks:
            yield task, _of(found, lambda row, task=task: row["task"] == task)


def _of(found: Found, belongs: Callable[[Row], bool]) -> Found:
    return {name: [row for row in rows if belongs(row)] for name, rows in found.items()}


def _line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    count = Count(name, rows)
    motion = count.motion
    moved = (MEASURES[m].form.format(motion[m]) if m in motion else "-" for m in MOTION)
    return (name, *count.cells(), *cost_cells(Cost.of(rows)), *moved, count.ended_by())
