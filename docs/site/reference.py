"""Write the reference pages that come from the command line and the planner's settings.

    python docs/site/reference.py            # writes docs/reference/commands.md and planner.md

They are kept in the repository, to be read there too; a test holds them to the code.
"""

import dataclasses
import types
import typing
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, get_args, get_origin

import tyro
from docstring_parser import DocstringStyle, parse

from sumo_dist.cli import COMMANDS
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.settings import SETTINGS
from sumo_dist.rollout import ENGINES

PAGES = Path(__file__).parents[1] / "reference"
VALUES = {int: "INT", float: "FLOAT", str: "TEXT", Path: "PATH"}
LEFT_OUT = (tyro.conf.Suppress,)

COMMANDS_HEAD = """# Commands

`sumo-dist COMMAND [options]`. `sumo-dist help` lists all, `sumo-dist COMMAND --help` has what is
here. Exit codes: 0 success, 1 task not achieved, 2 wrong usage, 3 fault, 130 interrupted. An option
that is on or off is switched by `--NAME` and `--no-NAME`.

This page is written by `deploy/site`.
"""

PLANNER_HEAD = """# Settings of the planner

`--set NAME=VALUE` of `sumo-dist run` and of the benches, `planner={...}` in a script,
`sumo-dist ctl planner NAME=VALUE` during a run. The defaults hold, over them what a task states
(`sumo-dist list TASK`), over them what is asked for; the recording has the result.

This page is written by `deploy/site`.

| setting | default | what it is | what it may be |
|---|---|---|---|
"""


def commands() -> str:
    """Return the page of all commands."""
    return COMMANDS_HEAD + "".join(map(command, COMMANDS))


def command(name: str) -> str:
    """Lay out one command: what it does, its arguments and options."""
    found = COMMANDS[name]
    options = getattr(import_module(found.module), found.options)
    rows = [
        f"| `{spelled}` | {cell(about)} | {cell(default)} |\n"
        for spelled, about, default in arguments(options)
    ]
    table = "| | | default |\n|---|---|---|\n" + "".join(rows) if rows else ""
    return f"\n## sumo-dist {name}\n\n{found.summary}.\n\n{table}"


def arguments(options: type, prefix: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield how each argument of an options' dataclass is spelled, what it is, its default."""
    hints = typing.get_type_hints(options, include_extras=True)
    described = descriptions(options)
    for field in dataclasses.fields(options):
        kind, marks = unwrapped(hints[field.name])
        name = f"{prefix}{field.name.replace('_', '-')}"
        if any(mark in marks for mark in LEFT_OUT):
            continue
        if dataclasses.is_dataclass(kind):
            yield from arguments(typing.cast(type, kind), f"{name}.")
            continue
        value = placeholder(kind)
        if tyro.conf.Positional in marks:
            spelled = field.name.upper() + (" ..." if get_origin(kind) is tuple else "")
        else:
            spelled = f"--{name} {value}".rstrip()
        yield spelled, described[field.name], default_of(field)


def unwrapped(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """Split an annotation into the type and tyro's marks."""
    if get_origin(hint) is typing.Annotated:
        return get_args(hint)[0], hint.__metadata__
    return hint, ()


def placeholder(kind: Any) -> str:
    """Say in one word what an option takes; nothing for those that are on or off."""
    if get_origin(kind) in (types.UnionType, typing.Union):
        (kind,) = (part for part in get_args(kind) if part is not type(None))
    if get_origin(kind) is typing.Literal:
        return "{" + ",".join(get_args(kind)) + "}"
    if get_origin(kind) is tuple:
        return f"{placeholder(get_args(kind)[0])} ..."
    return "" if kind is bool else VALUES[kind]


def descriptions(options: type) -> Mapping[str, str]:
    """Return what the docstrings of a dataclass and those it extends say of each attribute."""
    return {
        name: " ".join((entry.description or "").split())
        for base in reversed(options.__mro__)
        if dataclasses.is_dataclass(base)
        for entry in parse(base.__doc__ or "", DocstringStyle.GOOGLE).params
        for name in entry.arg_name.split(", ")
    }


def default_of(field: dataclasses.Field[Any]) -> str:
    """Return a field's default as text: none is "required", a default of None is empty."""
    if field.default_factory is not dataclasses.MISSING:
        return ""  # it depends on the machine; the description says on what
    if field.default is dataclasses.MISSING:
        return "required"
    match field.default:
        case None | () | "":
            return ""
        case bool(on):
            return "on" if on else "off"
        case tuple(several):
            return f"`{' '.join(map(str, several))}`"
        case value:
            return f"`{value}`"


def cell(text: str) -> str:
    """Return a text as a cell of a table has it."""
    return text.replace("|", "\\|")


def planner() -> str:
    """Return the page of the planner's settings."""
    rows = "".join(
        f"| `{name}` | {f'`{value}`' if value != '' else ''} "
        f"| {cell(SETTINGS[name].about)} | {cell(SETTINGS[name].valid)} |\n"
        for name, value in dataclasses.asdict(PlannerConfig()).items()
    )
    others = f"Optimizers: {listed(OPTIMIZERS)}. Engines, by `--engine`: {listed(ENGINES)}.\n"
    return f"{PLANNER_HEAD}{rows}\n{others}"


def listed(names: Any) -> str:
    """List names as code."""
    return ", ".join(f"`{name}`" for name in names)


if __name__ == "__main__":
    (PAGES / "commands.md").write_text(commands(), encoding="utf-8")
    (PAGES / "planner.md").write_text(planner(), encoding="utf-8")
