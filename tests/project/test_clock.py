"""Clocks that jump do not matter: nothing that runs a robot reads the wall's."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "sumo_dist"
FOLDERS = ("episode", "planner", "wire", "estimate", "rollout", "robots", "chaos")
SERVICES = sorted((PACKAGE.parent / "services").glob("*.py"))
FILES = sorted(path for folder in FOLDERS for path in (PACKAGE / folder).rglob("*.py"))

WALL = {("time", "time"), ("time", "time_ns"), ("datetime", "now"), ("datetime", "utcnow")}


def wall_clock_reads(source: str) -> Iterator[int]:
    """Lines that read a clock which somebody may set."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Attribute(value=ast.Name(id=module), attr=name) if (module, name) in WALL:
                yield node.lineno
            case ast.ImportFrom(module="time", names=names) if any(n.name == "time" for n in names):
                yield node.lineno


def test_reads_are_found():
    source = "import time\nfrom time import time\nx = time.time()\ny = time.monotonic()"
    assert list(wall_clock_reads(source)) == [2, 3]


@pytest.mark.parametrize("path", [*FILES, *SERVICES], ids=lambda path: path.name)
def test_control_reads_no_clock_that_can_be_set(path):
    assert not list(wall_clock_reads(path.read_text("utf-8")))
