"""Which part may import which: the library knows no bus, no viewer and no clock."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "sumo_dist"
LIBRARY = ("math", "robots", "model", "costs", "optim", "planner", "rollout", "estimate")
DATA = ("errors", "policies", "tasks")  # what the library plans with, as free of processes as it is
RERUN_USERS = (
    "sumo_dist.commands.doctor",  # asks whether it is there
    "sumo_dist.record.replay",
    "sumo_dist.services.tracer",
    "sumo_dist.view",
)


def modules() -> dict[str, Path]:
    """Every module of the package by its dotted name, the linked folders included."""
    found = {}
    for folder, _, files in os.walk(PACKAGE, followlinks=True):
        for name in files:
            if name.endswith(".py"):
                path = Path(folder, name)
                parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
                found[".".join(part for part in parts if part != "__init__")] = path
    return found


MODULES = modules()


def imported_names(source: str, module: str, is_package: bool = False) -> Iterator[str]:
    """Dotted names that a source imports anywhere: in functions too, or through import_module."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=origin, names=names, level=level):
                parents = module.split(".")[: None if is_package and level == 1 else -level]
                base = ".".join([*(parents if level else []), *([origin] if origin else [])])
                yield base
                yield from (f"{base}.{alias.name}" for alias in names)
            case ast.Call(
                func=ast.Name(id="import_module" | "__import__")
                | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                yield name


@cache
def imports(module: str) -> frozenset[str]:
    path = MODULES[module]
    names = imported_names(path.read_text("utf-8"), module, path.name == "__init__.py")
    return frozenset(names)


def is_in(name: str, packages: tuple[str, ...]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def users_of(*packages: str) -> set[str]:
    return {module for module in MODULES if any(is_in(name, packages) for name in imports(module))}


def in_parts(parts: tuple[str, ...]) -> list[str]:
    return sorted(name for name in MODULES if is_in(name, tuple(f"sumo_dist.{p}" for p in parts)))


def test_imports_are_found_wherever_they_stand():
    source = """
import a.b as c
from d import e
from . import f
from ..g import h
def late():
    import zenoh
    importlib.import_module("rerun.blueprint")
"""
    found = set(imported_names(source, "sumo_dist.x.y"))
    expected = {"a.b", "d", "d.e", "sumo_dist.x.f", "sumo_dist.g.h", "zenoh", "rerun.blueprint"}
    assert expected <= found
    assert "sumo_dist.x.y.f" in set(imported_names("from . import f", "sumo_dist.x.y", True))


def test_every_part_of_the_library_is_looked_at():
    for part in LIBRARY + DATA:
        assert in_parts((part,)), part


@pytest.mark.parametrize("module", in_parts(LIBRARY))
def test_library_knows_no_bus_viewer_or_clock(module):
    banned = ("zenoh", "msgpack", "rerun", "time", "datetime")
    assert not [name for name in imports(module) if is_in(name, banned)]


@pytest.mark.parametrize("module", in_parts(LIBRARY + DATA))
def test_arrows_point_from_processes_to_the_library(module):
    below = tuple(f"sumo_dist.{part}" for part in LIBRARY + DATA)
    ours = {name for name in imports(module) if is_in(name, ("sumo_dist",))}
    assert not [name for name in ours - {"sumo_dist"} if not is_in(name, below)]


def test_only_wire_imports_zenoh_and_msgpack():
    users = users_of("zenoh", "msgpack")
    assert users
    assert not [module for module in users if not is_in(module, ("sumo_dist.wire",))]


def test_only_the_viewing_parts_import_rerun():
    users = users_of("rerun")
    assert users
    assert not [module for module in users if not is_in(module, RERUN_USERS)]


def test_linked_folders_are_imported_through_the_package():
    assert users_of("assets", "policies", "services", "tasks") == set()


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("sumo_dist.planner.evaluate", ("zenoh", "msgpack", "rerun", "torch")),
        ("sumo_dist.planner.planner", ("zenoh", "msgpack", "rerun", "torch")),
        ("sumo_dist.services.rollout_worker", ("rerun", "imageio", "torch")),
        ("sumo_dist.cli", ("rerun", "imageio", "torch")),
    ],
)
def test_what_an_import_really_loads(module, absent):
    code = f"import sys, {module}; print([name for name in {absent} if name in sys.modules])"
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, cwd=PACKAGE.parent, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stdout == "[]\n", done.stderr
