"""What is worth trying of each weight, parameter and setting: for sliders and for `tune`.

What a number may be, `planner.settings` and `Parameter.range` say; those limits guard against slips
and are far wider than what is of use.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from sumo_dist.costs.table import CostSettings
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.settings import SETTINGS
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK, TICK_RATE

FACTOR = (
    10.0  # a weight is worth trying down to this fraction of the task's, and up to the multiple
)

Kind = Literal["float", "int", "choice"]


@dataclass(frozen=True, kw_only=True)
class Range:
    """The useful values of one number or name.

    Attributes:
        name: of the weight, parameter or setting.
        kind: "float", "int" or "choice".
        default: what it is unless somebody says otherwise.
        low, high: ends of a float or int, both included.
        log: equal ratios are equal steps. Both ends are then above 0, or both below.
        step: values are whole multiples of it; 0 if there is none.
        unit: such as "m" or "s".
        choices: what a choice may be.
        about: what it is, in a few words.
    """

    name: str
    kind: Kind
    default: float | int | str
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    step: float = 0.0
    unit: str = ""
    choices: tuple[str | float, ...] = ()
    about: str = ""


def weight_ranges(task: Task, now: CostSettings | None = None) -> dict[str, Range]:
    """Return a range for each weight: a factor up and down, on a log scale.

    A weight of 0 has no factor: it goes from 0 to 10.

    Args:
        task: whose weights they are.
        now: what they are; by default the task's own.
    """
    weights = (now or task.table.defaults).weights.tolist()
    return {
        name: _of_weight(name, weight, f"weight of {name}")
        for name, weight in zip(task.table.terms, weights, strict=True)
    }


def parameter_ranges(task: Task, now: CostSettings | None = None) -> dict[str, tuple[Range, ...]]:
    """Return the ranges of each parameter, one a number; an open end is put near what it is.

    Args:
        task: whose parameters they are.
        now: what they are; by default the task's own.
    """
    found, named = {}, task.table.named((now or task.table.defaults).parameters)
    for name, parameter in task.table.parameters.items():
        numbers = parameter.checked(getattr(named, name)).tolist()
        found[name] = tuple(
            Range(
                name=name,
                kind="float",
                default=number,
                low=_near(parameter.range[0], number, -1.0),
                high=_near(parameter.range[1], number, 1.0),
                unit=parameter.unit,
                about=f"parameter {name}" + (f", number {i + 1}" if len(numbers) > 1 else ""),
            )
            for i, number in enumerate(numbers)
        )
    return found


def setting_ranges(planner: PlannerConfig) -> dict[str, Range]:
    """Return a range for each setting of the planner, wide enough for its value now.

    The file of a policy has none; neither has guidance, which goes with it, another value.
    """
    found = {}
    for name, useful in _USEFUL.items():
        now, about = getattr(planner, name), SETTINGS[name].about
        if useful.kind == "choice":
            choices = useful.choices or SETTINGS[name].choices
            if name == "guidance":
                choices = ("learned",) if planner.policy else ("none", "object")
            extra = () if now in choices else (now,)
            found[name] = replace(useful, default=now, choices=(*choices, *extra), about=about)
        else:
            low, high = min(useful.low, now), max(useful.high, now)
            found[name] = replace(useful, default=now, low=low, high=high, about=about)
    return found


def _of_weight(name: str, weight: float, about: str) -> Range:
    if weight == 0.0:
        return Range(name=name, kind="float", default=weight, low=0.0, high=FACTOR, about=about)
    low, high = sorted((weight / FACTOR, weight * FACTOR))
    return Range(name=name, kind="float", default=weight, low=low, high=high, log=True, about=about)


def _near(end: float, default: float, side: float) -> float:
    """Return an end of a range, or, of an open one, a place twice as far out as the default."""
    return end if math.isfinite(end) else default + side * max(1.0, 2.0 * abs(default))


def _float(low: float, high: float, *, log: bool = False, step: float = 0.0) -> Range:
    return Range(name="", kind="float", default=low, low=low, high=high, log=log, step=step)


def _int(low: int, high: int, *, log: bool = False) -> Range:
    return Range(name="", kind="int", default=low, low=low, high=high, log=log)


def _choice(*choices: float) -> Range:
    return Range(
        name="", kind="choice", default="", choices=choices
    )  # of texts: all that are valid


_SHAPES: Mapping[str, Range] = {
    "optimizer": _choice(),
    "horizon": replace(_float(0.4, 3.0, step=TICK), unit="s"),
    "rate": _int(5, TICK_RATE),
    "rollouts": _int(4, 128, log=True),
    "nodes": _int(3, 10),  # the smooth spline's least
    "spline": _choice(),
    "iterations": _int(1, 4),  # of 4 rollouts at least
    "decay": _float(1.0, 3.0),
    "variance_first": _float(0.001, 1.0, log=True),
    "variance_last": _float(0.01, 4.0, log=True),
    "base_noise": _float(0.2, 8.0, log=True),
    "noise_exponent": _float(0.0, 4.0),
    "placement": _choice(),
    "execute": _choice(),
    "elites": _int(1, 16),
    "temperature": _float(0.01, 10.0, log=True),
    "timestep": replace(_choice(0.02, 0.01, 0.005, 0.004, 0.002), unit="s"),
    "fluid_density": replace(_float(0.0, 2.0), unit="kg/m^3"),
    "model": _choice(),
    "guidance": _choice(),
    "guided": _float(0.0, 1.0),
}
_USEFUL = {name: replace(shape, name=name) for name, shape in _SHAPES.items()}
