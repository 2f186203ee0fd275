"""Where two recordings of an episode part, in words."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sumo_dist.model.coordinates import coordinates
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK

# In the order in which one follows from the other within a tick.
_BEFORE = ("states", "estimates", "memories")
_PLANS = ("weights", "parameters", "terms", "costs", "knots")
_AFTER = ("actions", "targets")
_CALLED = {
    "states": "the true state",
    "estimates": "the estimated state",
    "memories": "the policy's memory",
    "weights": "the weight",
    "parameters": "the parameter",
    "terms": "the cost term of the plan before noise,",
    "costs": "the cost",
    "knots": "the plan,",
    "actions": "the action",
    "targets": "the joint target",
}


@dataclass(frozen=True)
class Difference:
    """The first number in which two recordings differ.

    Attributes:
        tick: policy tick.
        plan: number of the plan it belongs to; None if to none.
        what: field of the recordings.
        text: all of it in words.
    """

    tick: int
    plan: int | None
    what: str
    text: str


def first_difference(recorded: Recording, again: Recording, world: World) -> Difference | None:
    """Return where two recordings of an episode part; None if they are equal to the last bit.

    Only what both have is compared, and how many ticks and plans there are last. A term, a cost and
    a plan belong together: the one that the others follow from is named.

    Args:
        recorded: the one.
        again: the other, named "now".
        world: that both are of.
    """
    found = [
        each
        for order, name in enumerate((*_BEFORE, *_PLANS, *_AFTER))
        for each in _differing(recorded, again, name, order)
    ]
    if not found:
        return _lengths(recorded, again)
    tick, _, plan, name = min(found, key=lambda each: each[:2])
    number = None if plan is None else int(recorded.plan_numbers[plan])
    row = tick if plan is None else plan
    where = _largest(getattr(recorded, name)[row], getattr(again, name)[row])
    before, now = (np.asarray(getattr(each, name)[row])[where] for each in (recorded, again))
    of = "" if number is None else f", plan {number}"
    which = _name(name, where, recorded, world)
    text = (
        f"tick {tick} ({tick * TICK:.2f} s){of}: {_CALLED[name]} {which} "
        f"was {before!s} and is {now!s} now (off by {abs(float(now) - float(before)):.3g})"
    )
    return Difference(tick, number, name, text)


_Found = tuple[int, int, int | None, str]
"""Tick, place in the order of a tick, row of a plan, field."""


def _differing(recorded: Recording, again: Recording, name: str, order: int) -> Iterator[_Found]:
    """Yield the first row of a field that differs, if one does."""
    for row, pair in enumerate(zip(getattr(recorded, name), getattr(again, name), strict=False)):
        before, now = (np.asarray(each) for each in pair)
        if before.shape != now.shape or not np.array_equal(before, now, equal_nan=True):
            if name in _PLANS:
                yield int(recorded.plan_ticks[row]), order, row, name
            else:
                yield row, order, None, name
            return


def _largest(before: np.ndarray, now: np.ndarray) -> tuple[int, ...]:
    """Index of the number that differs most, in units of its own size."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.asarray(now, float) - before) / np.maximum(np.abs(before), 1e-12)
    differs = np.asarray(before != now)
    off = np.where(differs, np.nan_to_num(off, nan=np.inf, posinf=np.inf), -1.0)
    return tuple(int(i) for i in np.unravel_index(int(np.argmax(off)), off.shape))


def _lengths(recorded: Recording, again: Recording) -> Difference | None:
    """Compare how much there is, and how it ended."""
    for name, things in (("states", "states"), ("plan_numbers", "plans")):
        before, now = len(getattr(recorded, name)), len(getattr(again, name))
        if before != now:
            text = f"there were {before} {things} and are {now} now, the others are the same"
            return Difference(min(len(recorded.states), len(again.states)), None, name, text)
    return None


def _name(field: str, where: tuple[int, ...], recorded: Recording, world: World) -> str:
    """Name a number of a field."""
    task = world.task
    first = where[0] if where else 0
    if field in ("states", "estimates"):
        name, unit = coordinates(world.model)[first]
        return f"{name} [{unit}]"
    if field == "knots":
        searched = [task.actions.names[i] for i in task.actions.searched]
        return f"{searched[where[1]]} at knot {where[0]} (normalised),"
    if field == "costs":
        return f"of candidate {first}"
    names: dict[str, Sequence[str]] = {
        "terms": recorded.config["terms"],
        "weights": recorded.config["terms"],
        "parameters": _parameter_names(task),
        "actions": task.actions.names,
        "targets": task.scene.robot.joints,
    }
    return f"{names[field][first]}" if field in names else f"at {first}"


def _parameter_names(task: Task) -> list[str]:
    names = []
    for parameter in task.parameters:
        alone = parameter.size == 1
        names += [
            parameter.name if alone else f"{parameter.name}[{i}]" for i in range(parameter.size)
        ]
    return names
