"""A wall clock that jumps changes nothing: no code of the package reads it to run a robot."""

import ast
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "sumo_dist"
NAMES_A_FOLDER = PACKAGE / "commands" / "run.py"  # by the date, before anything is started
BY_THE_DATE = {  # certificates end on one, folders are named by one, and clocks are compared
    NAMES_A_FOLDER,
    PACKAGE / "commands" / "doctor.py",
    PACKAGE / "commands" / "keys.py",
    PACKAGE / "hosts" / "examine.py",
    PACKAGE / "hosts" / "run.py",
    *(PACKAGE / "authority").glob("*.py"),
}
FILES = sorted(
    Path(folder, name)
    for folder, _, names in os.walk(PACKAGE, followlinks=True)  # services, tasks, policies too
    for name in names
    if name.endswith(".py")
)
WALL = {
    "time": {"time", "time_ns", "localtime", "gmtime", "ctime", "strftime", "CLOCK_REALTIME"},
    "datetime": {"now", "utcnow", "today"},
}


def wall_clock_reads(source: str) -> Iterator[int]:
    """Lines that read a clock which somebody may set."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case (
                ast.Attribute(value=ast.Name(id=module), attr=name)
                | ast.Attribute(value=ast.Attribute(attr=module), attr=name)
            ) if name in WALL.get(module, ()):
                yield node.lineno
            case ast.ImportFrom(module="time", names=names):
                yield from (node.lineno for n in names if n.name in WALL["time"])


def test_reads_are_found():
    source = "import time\nfrom time import time\nx = time.time()\ny = time.monotonic()"
    assert list(wall_clock_reads(source)) == [2, 3]
    assert list(wall_clock_reads("datetime.datetime.now()\ndatetime.now()")) == [1, 2]
    assert list(wall_clock_reads("time.clock_gettime(time.CLOCK_REALTIME)")) == [1]
    assert list(wall_clock_reads(NAMES_A_FOLDER.read_text("utf-8")))


def test_all_folders_of_the_control_path_are_read():
    folders = {path.relative_to(PACKAGE).parts[0] for path in FILES}
    assert folders >= {"dispatch", "episode", "estimate", "launch", "optim", "planner", "plant"}
    assert folders >= {"policies", "robots", "rollout", "services", "tasks", "wire"}


@pytest.mark.parametrize(
    "path",
    [path for path in FILES if path not in BY_THE_DATE],
    ids=lambda path: str(path.relative_to(PACKAGE)),
)
def test_no_clock_that_can_be_set_is_read(path):
    assert not list(wall_clock_reads(path.read_text("utf-8")))
