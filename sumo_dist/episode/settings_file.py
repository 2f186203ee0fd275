"""A file of weights, parameters and planner settings for a task, and what is said beside it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

from sumo_dist.costs.table import CostSettings
from sumo_dist.errors import UsageError, unknown
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.learned import driving
from sumo_dist.tables import read_table
from sumo_dist.tasks.task import Task

PARTS = ("task", "weights", "parameters", "planner", "origin")
DEFAULT = "default"  # the preset where none is asked for


@dataclass(frozen=True)
class SettingsFile:
    """What a settings file says.

    Attributes:
        task: name of the task that it is for; "" is any that has these names.
        weights: of cost terms, by name.
        parameters: by name, a number or a few.
        planner: settings by name.
        origin: where they came from; for people.
    """

    task: str = ""
    weights: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    planner: Mapping[str, int | float | str] = field(default_factory=dict)
    origin: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file.

        Raises:
            UsageError: it cannot be read, or is no settings file.
        """
        found = read_table(path, "settings file")
        for name, value in found.items():
            if name not in PARTS:
                raise UsageError(f"{path}: {unknown('entry', name, PARTS)}")
            kind, what = (str, "a text") if name == "task" else (dict, "a table")
            if not isinstance(value, kind):
                raise UsageError(f"{path}: {name} must be {what}, got {value!r}")
        for name, value in found.get("weights", {}).items():
            if not _is_number(value):
                raise UsageError(f"{path}: weight {name!r} must be a number, got {value!r}")
        for name, value in found.get("parameters", {}).items():
            if not all(_is_number(n) for n in (value if isinstance(value, list) else [value])):
                raise UsageError(f"{path}: parameter {name!r} must be numbers, got {value!r}")
        return cls(**found)

    @classmethod
    def of(cls, task: Task, planner: PlannerConfig, cost: CostSettings, origin: Any) -> Self:
        """Say all that an episode's settings are, changed or not."""
        table = task.table
        named = table.named(cost.parameters)
        parameters = {name: getattr(named, name) for name in table.parameters}
        return cls(
            task.name,
            dict(zip(table.terms, cost.weights.tolist(), strict=True)),
            {n: v if isinstance(v, float) else v.tolist() for n, v in parameters.items()},
            asdict(planner),
            origin,
        )

    @property
    def toml(self) -> str:
        """The file's text."""
        lines = [f"task = {_toml(self.task)}"]
        for part in PARTS[1:]:
            if entries := getattr(self, part):
                lines += ["", f"[{part}]"]
                lines += [f"{_key(name)} = {_toml(value)}" for name, value in entries.items()]
        return "\n".join(lines) + "\n"

    def texts(self, part: str) -> dict[str, str]:
        """Weights or parameters by name, as texts such as "goal=1.0,0.0"."""
        found = {}
        for name, value in getattr(self, part).items():
            numbers = value if isinstance(value, Sequence) else [value]
            found[name] = f"{name}={','.join(repr(float(number)) for number in numbers)}"
        return found

    def check(self, task: Task) -> None:
        """Raise a UsageError if this is for another task, or has names or values not of it."""
        if self.task not in ("", task.name):
            raise UsageError(
                f"it is for {self.task}, not {task.name}; without its line `task` it is for any "
                "task that has these weights and parameters"
            )
        task.table.adjusted([*self.texts("weights").values()], [*self.texts("parameters").values()])
        PlannerConfig.resolve(task.planner).changed(self.planner)


def resolved(
    task: Task,
    file: Path | None,
    preset: str,
    optimizer: str | None,
    changes: Sequence[str],
    weight: Sequence[str],
    param: Sequence[str],
    policy: Path | None = None,
) -> dict[str, Any]:
    """Return `planner`, `weight` and `param` of an EpisodeConfig, from what a command line says.

    The preset's settings come first, over them the task's, the file's, those under which a learned
    policy drives, and what stands beside it.

    Args:
        task: what is done.
        file: of settings, if there is one.
        preset: name of the settings to start from.
        optimizer: takes the place of all others, with the settings that make it itself.
        changes: of the planner's settings, "key=value".
        weight: of cost terms, such as "goal=80".
        param: such as "goal=1,0".
        policy: file of a learned policy that drives, if one does.

    Raises:
        UsageError: a file or the command line says what cannot be.
    """
    drives = driving(policy) if policy is not None else {}
    if file is None:
        stated = {**task.planner, **drives}
        planner = PlannerConfig.resolve(stated, preset, optimizer, changes)
        return {"planner": planner, "weight": tuple(weight), "param": tuple(param)}
    found = SettingsFile.read(file)
    if found.planner and preset != DEFAULT:
        raise UsageError(
            f"--preset {preset} and --settings {file}: both say what the planner's settings start "
            "from; give one of them"
        )
    try:
        found.check(task)
    except UsageError as error:
        raise UsageError(f"{file}: {error}") from None
    stated = {**task.planner, **found.planner, **drives}
    return {
        "planner": PlannerConfig.resolve(stated, preset, optimizer, changes),
        "weight": _over(found.texts("weights"), weight),
        "param": _over(found.texts("parameters"), param),
    }


def _over(of_file: Mapping[str, str], given: Sequence[str]) -> tuple[str, ...]:
    """Return the texts of a file without those that are given anew, then the given ones."""
    anew = {text.partition("=")[0].strip() for text in given}
    return (*(text for name, text in of_file.items() if name not in anew), *given)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _key(name: str) -> str:
    """Write a name as a key of TOML."""
    return name if name.isascii() and name.replace("_", "").isalnum() else json.dumps(name)


def _toml(value: Any) -> str:
    """Write a text, a number or a list of them as TOML; JSON's texts are TOML's too."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value) if isinstance(value, str) else repr(value)
