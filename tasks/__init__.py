"""Finding tasks: ours by name, those of installed packages by entry point, a user's by file."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from sumo_dist.costs.blame import blamed
from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.files import ASSETS, find_model
from sumo_dist.model.scene import SceneObject
from sumo_dist.tasks.g1.door import door_open
from sumo_dist.tasks.g1.push import PUSHES
from sumo_dist.tasks.spot.analysis import ANALYSIS
from sumo_dist.tasks.spot.demos import DEMONSTRATIONS
from sumo_dist.tasks.spot.end_to_end import END_TO_END
from sumo_dist.tasks.spot.extras import EXTRAS
from sumo_dist.tasks.spot.joints_upright import JOINTS_UPRIGHT
from sumo_dist.tasks.task import Task

GROUP = "sumo_dist.tasks"
TASK_FILES = (
    "SUMO_DIST_TASK_FILES"  # names a folder of copies, FOLDER/NAME.py for /.../FOLDER/NAME.py
)
_BESIDE: set[str] = set()  # names of modules that task files have imported from beside them
_OURS = {
    **ANALYSIS,
    **DEMONSTRATIONS,
    **EXTRAS,
    **END_TO_END,
    **JOINTS_UPRIGHT,
    **PUSHES,
    "g1/door_open": door_open,
}


def task_names() -> tuple[str, ...]:
    """Names of all tasks that `load_task` knows by name."""
    return tuple(sorted({*_OURS, *(point.name for point in entry_points(group=GROUP))}))


def task_source(text: str) -> str:
    """What `load_task` finds the same task by from any working directory."""
    return str(Path(text).absolute()) if text.endswith(".py") else text


def load_task(source: str) -> Task:
    """Build a task.

    Args:
        source: a name, ours or one that a package adds under the entry point group
            sumo_dist.tasks; or the path of a Python file that defines `task() -> Task`. Model files
            that a task names are looked for beside the file that defines it, then below assets/.

    Raises:
        UsageError: there is no such task, or its file or package is at fault.
    """
    if source.endswith(".py"):
        return _from_file(task_file(source))
    points = [point for point in entry_points(group=GROUP) if point.name == source]
    if len(points) + (source in _OURS) > 1:
        raise UsageError(f"task {source!r} is defined more than once, also by {points[0].value}")
    if source in _OURS:
        return replace(_OURS[source](), source=source)
    if not points:
        raise unknown("task", source, ["/a/path/to/a/task.py", *task_names()])
    return _from_package(points[0])


def task_file(source: str) -> Path:
    """Return where a task file is on this host: its copy of it, if it has been given one."""
    path = Path(task_source(source))
    if folder := os.environ.get(TASK_FILES):
        copy = Path(folder, path.parent.name, path.name)
        if copy.is_file():
            return copy
    return path


def _from_file(path: Path) -> Task:
    where = f"task file {path}"
    if not path.is_file():
        raise UsageError(f"{where} does not exist on this host")
    module = ModuleType(f"sumo_dist_task_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # dataclasses and inspect look it up there
    with _importing_from(path.parent):
        with blamed(where):
            exec(compile(path.read_bytes(), path, "exec"), vars(module))
        build = getattr(module, "task", None)
        if not callable(build):
            raise UsageError(f"{where} defines no function task() that returns a Task")
        return replace(_build(where, build, path.parent), source=str(path))


@contextmanager
def _importing_from(folder: Path) -> Iterator[None]:
    """Let a task file import modules beside it, as they are now; installed ones come first."""
    for name in list(_BESIDE):  # of another folder, or changed since
        sys.modules.pop(name, None)
        _BESIDE.discard(name)
    known = set(sys.modules)
    sys.path.append(str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in set(sys.modules) - known:
            if Path(getattr(sys.modules[name], "__file__", None) or "").parent == folder:
                _BESIDE.add(name)


def _from_package(point: EntryPoint) -> Task:
    where = f"task {point.name!r} of the entry point {point.value}"
    with blamed(where):
        build = point.load()
    module = sys.modules[point.module]
    task = _build(where, build, Path(module.__file__ or "").parent)
    if task.name != point.name:
        raise UsageError(f"{where} calls itself {task.name!r}; both names must be the same")
    return replace(task, source=point.name)


def _build(where: str, build: Callable[[], Any], folder: Path) -> Task:
    with blamed(where):
        task = build()
    if not isinstance(task, Task):
        raise UsageError(f"{where}: task() returned {type(task).__name__}, must return a Task")

    def beside(thing: SceneObject) -> SceneObject:
        try:
            path = find_model(thing.mjcf, (folder, ASSETS))
        except UsageError as error:
            raise UsageError(f"{where}: {error}") from None
        return thing if path == ASSETS / thing.mjcf else replace(thing, mjcf=str(path))

    objects, fixtures = (tuple(map(beside, t)) for t in (task.scene.objects, task.scene.fixtures))
    return replace(task, scene=replace(task.scene, objects=objects, fixtures=fixtures))
