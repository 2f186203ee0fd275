"""Which part may import which: arrows point down; the library knows no bus, viewer or clock."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "sumo_dist"
# Bottom to top: a room imports from itself and those before it. A file in sumo_dist/ is a room.
ROOMS = (
    *("errors", "timing", "provenance", "priority", "load", "signals", "terminal", "tables"),
    *("extras", "startup", "authority"),
    *("math", "policies", "robots", "model", "costs", "rollout", "optim"),
    *("planner.settings", "planner.config", "tasks", "planner"),  # a task may state settings
    *("estimate", "plant", "record", "episode", "learn", "check", "wire", "dispatch"),
    *("control", "view", "export"),
    *(
        "services",
        "launch",
        "hosts",
        "bench",
        "bench.results",
        "bench.campaign",
        "bench.tune",
        "faults",
        "bench.measure",
    ),
    *("commands", "cli", "__main__"),
)
WITHOUT_CLOCK = ("math", *ROOMS[ROOMS.index("robots") : ROOMS.index("estimate") + 1])
RERUN_USERS = (
    "sumo_dist.commands.doctor",  # asks whether it is there
    "sumo_dist.view",
)
ZENOH_USERS = (
    "sumo_dist.wire",
    "sumo_dist.faults.bridge",  # passes on, late, twice or spoilt, what it does not decode
    "sumo_dist.faults.tamper",
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


def room(module: str) -> str:
    """The room that a module is in: the longest that its name begins with."""
    inner = module.removeprefix("sumo_dist.")
    return max((r for r in ROOMS if is_in(inner, (r,))), key=len, default=inner)


def targets(module: str) -> set[str]:
    """Modules of ours that a module imports; of a package only what it names."""
    found = {name for name in imports(module) if name in MODULES and name != "sumo_dist"}
    packages = {name for name in found if any(other.startswith(f"{name}.") for other in found)}
    return found - packages - {module}


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Ways along the edges that come back to where they began, if there are any."""
    try:
        TopologicalSorter(edges).prepare()
    except CycleError as error:
        return [error.args[1]]
    return []


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


def test_every_module_is_in_a_room_and_every_room_has_one():
    assert {room(module) for module in MODULES if module != "sumo_dist"} == set(ROOMS)


@pytest.mark.parametrize("module", sorted(MODULES.keys() - {"sumo_dist"}))
def test_arrows_point_down(module):
    up = [name for name in targets(module) if ROOMS.index(room(name)) > ROOMS.index(room(module))]
    assert up == []


def test_no_files_import_each_other_in_a_circle():
    assert circles({module: targets(module) for module in MODULES}) == []
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}}) != []


@pytest.mark.parametrize("module", sorted(m for m in MODULES if room(m) in WITHOUT_CLOCK))
def test_library_knows_no_bus_viewer_or_clock(module):
    banned = ("zenoh", "msgpack", "rerun", "time", "datetime")
    assert not [name for name in imports(module) if is_in(name, banned)]


def test_only_wire_and_the_fault_bridge_import_zenoh_and_msgpack():
    users = users_of("zenoh", "msgpack")
    assert users
    assert not [module for module in users if not is_in(module, ZENOH_USERS)]


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
        ("sumo_dist.services.worker", ("rerun", "imageio", "torch")),
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
