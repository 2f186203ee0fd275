"""What is searched: which weights, parameters and settings, and from where to where."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from sumo_dist.bench.campaign.campaign import TrialSettings
from sumo_dist.costs.parameters import Parameters
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.referee import Referee
from sumo_dist.errors import UsageError, unknown
from sumo_dist.planner.ranges import Range, parameter_ranges, setting_ranges, weight_ranges
from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.task import Task

Part = Literal["weight", "param", "set"]
PARTS: tuple[Part, ...] = ("weight", "param", "set")
DIGITS = 4  # significant ones of a value: more say nothing, and are hard to read
FORM = "NAME=LOW:HIGH, or NAME=: for the range that is usual"

Values = Mapping[str, float | int | str]
"""What a trial tries, by the names of dimensions."""


class Dimension(NamedTuple):
    """One number or name that is searched.

    Attributes:
        part: the option that sets it.
        range: what it may be.
        place: of a parameter of several numbers, which one; else None.
    """

    part: Part
    range: Range
    place: int | None = None

    @property
    def name(self) -> str:
        """What tells it from all others: one name may be a weight's and a parameter's."""
        place = "" if self.place is None else f"[{self.place}]"
        return f"{self.part} {self.range.name}{place}"

    def rounded(self, value: Any) -> float | int | str:
        """Return a value as it is tried."""
        r = self.range
        if r.kind != "float":
            return int(value) if r.kind == "int" else value
        value = round(value / r.step) * r.step if r.step else value
        return min(max(float(f"{value:.{DIGITS}g}"), r.low), r.high)


@dataclass(frozen=True)
class Space:
    """What is searched, and what stays.

    Attributes:
        task: what is done.
        fixed: settings of every trial.
        dimensions: what differs between them.
    """

    task: Task
    fixed: TrialSettings
    dimensions: tuple[Dimension, ...]

    @classmethod
    def of(cls, task: Task, given: TrialSettings, weights: Sequence[str]) -> "Space":
        """Sort what was asked for into what is searched and what stays.

        Args:
            task: what is done.
            given: options of the command line; of their weights, parameters and settings those that
                are ranges, LOW:HIGH, are searched.
            weights: names of weights that are searched in their usual range.

        Raises:
            UsageError: a range cannot be, or nothing is searched.
        """
        ranges, fixed = dict[Part, list[str]](), dict[str, tuple[str, ...]]()
        for part in PARTS:
            texts = getattr(given, part)
            ranges[part] = [text for text in texts if ":" in text.partition("=")[2]]
            fixed[part] = tuple(text for text in texts if text not in ranges[part])
        ranges["weight"] = [*(f"{name}=:" for name in weights), *ranges["weight"]]
        plain = replace(given, **fixed)
        start = plain.episode(task.source, 0)
        found = [*_searched(task, start, ranges)]
        _check(found, fixed)
        space = cls(task, plain, tuple(found))
        for dimension in found:
            for value in _ends(dimension.range):
                values = {**space.start, dimension.name: value}
                space.with_values(values).episode(task.source, 0).cost(task)
        return space

    @property
    def start(self) -> Values:
        """What the dimensions are unless they are searched."""
        return {d.name: d.range.default for d in self.dimensions}

    @property
    def has_start(self) -> bool:
        """Whether the task's own values are in the ranges."""
        return all(
            d.range.default in d.range.choices
            if d.range.kind == "choice"
            else d.range.low <= float(d.range.default) <= d.range.high
            for d in self.dimensions
        )

    def with_values(self, values: Values) -> TrialSettings:
        """Return the settings of a trial that tries these."""
        texts: dict[Part, dict[str, list[str]]] = {part: {} for part in PARTS}
        for d in self.dimensions:
            texts[d.part].setdefault(d.range.name, []).append(_text(values[d.name]))
        return replace(
            self.fixed,
            **{
                part: (
                    *getattr(self.fixed, part),
                    *(f"{n}={','.join(v)}" for n, v in named.items()),
                )
                for part, named in texts.items()
            },
        )


def deciding(task: Task) -> set[str]:
    """Names of the parameters that decide how an episode starts and when it is solved.

    A search over these would move the goal in place of the object.
    """
    read = set[str]()

    class Noted(Parameters):
        def __getattr__(self, name: str) -> Any:
            read.add(name)
            return super().__getattr__(name)

    numbers = task.table.defaults.parameters
    named = task.table.named(numbers)
    noted = Noted({name: getattr(named, name) for name in task.table.parameters})
    start = Start.of(task.scene, task.frames, noted)
    view = Referee(task, start.model).view(task.reset(np.random.default_rng(0), start))
    view.p = noted
    for test in (task.success, *task.failure.values()):
        test(view)
    return (read | ({"goal"} if task.goal is not None else set())) & {*task.table.parameters}


def _searched(
    task: Task, start: EpisodeConfig, ranges: Mapping[Part, Iterable[str]]
) -> Iterable[Dimension]:
    """Yield a dimension for each range, around what the episode has without it."""
    cost = start.cost(task)
    own = dict(zip(task.table.terms, cost.weights.tolist(), strict=True))
    for text in ranges["weight"]:
        name, spec = _parts("weight", text)
        if name not in own:
            raise unknown("cost term", name, own)
        usual = weight_ranges(task, cost)[name]
        yield Dimension("weight", _narrowed(usual, spec, text))
    for text in ranges["param"]:
        name, spec = _parts("param", text)
        free = [n for n in task.table.parameters if n not in deciding(task)]
        if name in task.table.parameters and name not in free:
            raise UsageError(
                f"parameter {name} decides where {task.name} starts or when it is solved, so a "
                f"search would make the task easier; valid: {', '.join(free) or 'none of its'}"
            )
        if name not in free:
            raise unknown("parameter", name, free)
        usual = parameter_ranges(task, cost)[name]
        for i, number in enumerate(usual):
            place = i if len(usual) > 1 else None
            yield Dimension("param", _narrowed(number, spec, text), place)
    for text in ranges["set"]:
        name, spec = _parts("set", text)
        settings = setting_ranges(start.planner)
        if name not in settings:
            raise unknown("setting", name, settings)
        yield Dimension("set", _narrowed(settings[name], spec, text))


def _parts(part: str, text: str) -> tuple[str, str]:
    name, _, spec = text.partition("=")
    if not name.strip():
        raise UsageError(f"--{part} {text!r} is not {FORM}")
    return name.strip(), spec.strip()


def _narrowed(usual: Range, spec: str, text: str) -> Range:
    """Return a range with the ends or choices that a text gives it."""
    if usual.kind == "choice":
        return usual if spec == ":" else replace(usual, choices=_choices(usual, spec, text))
    low, _, high = (end.strip() for end in spec.partition(":"))
    kind = int if usual.kind == "int" else float
    try:
        ends = [kind(low or usual.low), kind(high or usual.high)]
    except ValueError:
        ends = [np.nan, np.nan]
    if not np.isfinite(ends).all() or not ends[0] < ends[1]:
        what = "whole numbers" if kind is int else "numbers"
        raise UsageError(f"range {text!r}: its ends must be {what} with LOW < HIGH, as in {FORM}")
    return replace(usual, low=ends[0], high=ends[1], log=usual.log and ends[0] * ends[1] > 0)


def _choices(usual: Range, spec: str, text: str) -> tuple[str | float, ...]:
    kind = type(usual.default)
    try:
        chosen = tuple(kind(choice.strip()) for choice in spec.split(":"))
    except ValueError:
        chosen = ()
    if len({*chosen}) < 2 or len({*chosen}) < len(chosen):
        raise UsageError(f"choices {text!r}: give two or more different ones, as in NAME=ONE:OTHER")
    return chosen


def _check(found: Sequence[Dimension], fixed: Mapping[str, Sequence[str]]) -> None:
    if not found:
        raise UsageError(
            "nothing is searched: name weights, as in --weights goal,gripper, or give ranges, as "
            "in --weight goal=20:180, --param NAME=LOW:HIGH, --set rollouts=8:32"
        )
    names = [d.name for d in found]
    for dimension in found:
        if names.count(dimension.name) > 1:
            raise UsageError(f"{dimension.name} is searched twice; once is valid")
        for text in fixed[dimension.part]:
            if text.partition("=")[0].strip() == dimension.range.name:
                raise UsageError(f"--{dimension.part} {text} is fixed, and it is searched too")


def _ends(found: Range) -> Sequence[float | int | str]:
    return found.choices if found.kind == "choice" else (found.low, found.high)


def _text(value: float | int | str) -> str:
    return value if isinstance(value, str) else repr(value)
