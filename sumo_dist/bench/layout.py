"""What the benches share: checks of their options, and one way to print what they measured."""

import json
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from sumo_dist.errors import UsageError
from sumo_dist.provenance import timing_provenance
from sumo_dist.rollout import engine_identity

VERSIONS = ("sumo_dist", "mujoco", "python")

Result = Mapping[str, Any]


def run_bench(
    command: str,
    as_json: bool,
    measure: Callable[[], Result],
    text: Callable[[Result], Iterable[str]],
) -> Result:
    """Measure, and print what was found and on what machine.

    Args:
        command: heads the text.
        as_json: print one JSON object instead of the text.
        measure: returns what was found, as JSON has it.
        text: lays that out in paragraphs and tables.
    """
    about = timing_provenance()  # with the machine's load before it has to measure
    result = {**about, **measure()}
    if as_json:
        print(json.dumps(result, indent=1))
    else:
        print("\n\n".join((heading(command, result), *text(result))))
    return result


def heading(command: str, about: Result) -> str:
    """Say which command made the tables below, of which code, on what machine."""
    versions = ", ".join(f"{key.replace('_', '-')} {about[key]}" for key in VERSIONS)
    machine = f"{about['machine']}, load average {about['load']} at the start"
    return f"# sumo-dist {command}\n\n{versions}; {machine}."


def table(columns: Mapping[str, str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Lay out rows as Markdown.

    Args:
        columns: head -> format of a row's fields, such as "{p99:.1f} ms".
        rows: mappings with those fields.
    """
    return markdown([*columns], [[form.format(**row) for form in columns.values()] for row in rows])


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out a Markdown table that also reads well as it is."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join(
        f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))} |"
        for line in lines
    )


def spelled(command: str, options: Any, *positional: str) -> str:
    """Return the command line that asks for the same options.

    Args:
        command: such as "bench suite".
        options: a dataclass; what is as by default is left out.
        positional: names of its fields that stand without their names.
    """
    words = ["sumo-dist", *command.split(), *(str(getattr(options, name)) for name in positional)]
    for field in fields(options):
        value = getattr(options, field.name)
        if field.name in positional or value == field.default:
            continue
        option = f"--{field.name.replace('_', '-')}"
        if value is True:
            words.append(option)
            continue
        for one in value if isinstance(value, tuple) else (value,):
            words += [option, str(one)]
    return shlex.join(words)


def check_at_least(least: int, **options: int | None) -> None:
    """Raise a UsageError if an option that is given is less."""
    for name, value in options.items():
        if value is not None and value < least:
            raise UsageError(f"{name} must be at least {least}, got {value}")


def checked_engine(kind: str) -> tuple[str, str]:
    """Return name and build of an engine; a bench takes the fallback only if asked for by name."""
    name, build = engine_identity(kind)
    if name == "fallback" and kind != "fallback":
        raise UsageError(
            "the native engine is not in this installation (it was built without a C++ compiler); "
            "to bench the other one, say --engine fallback"
        )
    return name, build


@dataclass(frozen=True)
class SeedOptions:
    """Options of the benches that repeat one task with many seeds.

    Attributes:
        json: print one JSON object.
        task: what is done.
        trials: seeds of each row.
        seed0: the first seed.
    """

    json: bool = False
    task: str = "spot/move_box"
    trials: int = 5
    seed0: int = 1

    def __post_init__(self) -> None:
        check_at_least(1, trials=self.trials)

    @property
    def seeds(self) -> range:
        """The seeds of each row."""
        return range(self.seed0, self.seed0 + self.trials)

    def about(self) -> Result:
        """Return these options as the result has them, with the engine's name."""
        engine, _ = checked_engine("auto")
        return {"engine": engine, "task": self.task, "trials": self.trials, "seed0": self.seed0}
