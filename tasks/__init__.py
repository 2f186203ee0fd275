"""Finding tasks by name: ours, and those of installed packages by entry point."""

from collections.abc import Callable
from importlib import import_module
from importlib.metadata import entry_points

from sumo_dist.errors import UsageError, unknown
from sumo_dist.tasks.task import Task

GROUP = "sumo_dist.tasks"
_OURS = {"spot/move_box": "sumo_dist.tasks.spot.move_box"}


def task_names() -> tuple[str, ...]:
    """Names of all tasks that `load_task` knows."""
    return tuple(sorted({*_OURS, *(point.name for point in entry_points(group=GROUP))}))


def load_task(name: str) -> Task:
    """Build a task by name; packages add theirs under the entry point group sumo_dist.tasks."""
    others = [point for point in entry_points(group=GROUP) if point.name == name]
    if len(others) + (name in _OURS) > 1:
        raise UsageError(f"task {name!r} is defined more than once, also by {others[0].value}")
    if name in _OURS:
        return import_module(_OURS[name]).task()
    if not others:
        raise unknown("task", name, task_names())
    build: Callable[[], Task] = others[0].load()
    return build()
