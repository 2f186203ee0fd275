"""A recording as tables: one row a tick, and one row a plan, each column with its unit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sumo_dist.model.coordinates import coordinates
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World
from sumo_dist.timing import TICK


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        name: of the column.
        unit: of its numbers; "1" for those that have none.
        about: what it is.
        values: (rows,).
    """

    name: str
    unit: str
    about: str
    values: np.ndarray


def ticks_table(recording: Recording, world: World) -> list[Column]:
    """Return one row a tick: true and estimated state, what was commanded, the plan followed."""
    count = len(recording.states)
    ticks = np.arange(count)
    plans = followed(recording)
    numbers = np.append(np.asarray(recording.plan_numbers, np.int64), -1)
    table = [
        Column("tick", "1", "policy tick", ticks),
        Column("time", "s", "robot time since the start", np.round(ticks * TICK, 6)),
        Column("plan", "1", "number of the plan that is followed, -1: none", numbers[plans]),
    ]
    names = coordinates(world.model)
    kinds = [("state", "true", recording.states)]
    if recording.config["episode"]["estimator"] != "truth":
        kinds.append(
            ("estimate", "estimated, on which policy and planner act", recording.estimates)
        )
    for kind, which, rows in kinds:
        values = np.array(rows)
        table += [
            Column(f"{kind}.{name}", unit, f"{which} state", values[:, i])
            for i, (name, unit) in enumerate(names)
        ]
    table += _commanded(recording, world, count)
    table += _costs(recording, plans)
    return table


def plans_table(recording: Recording, world: World) -> list[Column]:
    """Return one row a plan: when, how long it took, its cost, what it was made with, its knots."""
    ticks, costs = np.asarray(recording.plan_ticks, np.int64), _rows(recording.costs)
    finite = np.where(np.isfinite(costs), costs, np.nan)
    nothing = np.full(len(ticks), np.nan)
    some = np.isfinite(finite).any(axis=1) if len(ticks) else np.zeros(0, bool)
    best, median = nothing.copy(), nothing.copy()
    best[some], median[some] = np.nanmin(finite[some], axis=1), np.nanmedian(finite[some], axis=1)
    counts = {
        "number": (recording.plan_numbers, "1", "counted from 0"),
        "tick": (ticks, "1", "policy tick it is anchored on"),
        "time": (np.round(ticks * TICK, 6), "s", "robot time of that tick"),
        "wall_ms": (recording.plan_ms, "ms", "wall time that it took"),
        "age": (np.asarray(recording.age_ticks) * TICK, "s", "age of its state when it was sent"),
        "rollouts": (recording.rollouts, "1", "candidates it was made of"),
        "lost": (recording.lost, "1", "candidates left out"),
        "reissued": (recording.reissued, "1", "candidates sent to a second worker"),
        "cost.best": (best, "1", "of the best candidate"),
        "cost.median": (median, "1", "of the median candidate"),
    }
    table = [Column(n, unit, about, np.array(v)) for n, (v, unit, about) in counts.items()]
    terms, parameters = recording.config["terms"], parameter_columns(world)
    about = "weighted cost of the candidate without noise"
    table += _each("term", about, terms, recording.terms)
    table += _each("weight", "weight of a cost term", terms, recording.weights)
    values = _rows(recording.parameters)
    table += [
        Column(f"parameter.{name}", unit or "1", "parameter of the task", values[:, i])
        for i, (name, unit) in enumerate(parameters if len(ticks) else [])
    ]
    numbers = range(costs.shape[1] if costs.ndim == 2 else 0)
    table += [Column(f"cost.{i}", "1", "of a candidate; inf: lost", costs[:, i]) for i in numbers]
    return table + _knots(recording, world)


def followed(recording: Recording) -> np.ndarray:
    """Row of the plan that is followed at each tick, (ticks,); -1 for none.

    It is the newest one that is anchored there or before. In realtime one that came late was
    followed from a later tick on, which a recording does not have.
    """
    begins = np.asarray(recording.plan_ticks, np.int64)
    return np.searchsorted(begins, np.arange(len(recording.states)), side="right") - 1


def aligned(rows: Sequence[np.ndarray], count: int, width: int) -> np.ndarray:
    """Rows of the first ticks, (count, width); nan for ticks that have none."""
    values = np.full((count, width), np.nan)
    given = np.array(rows).reshape(-1, width)[:count]
    values[: len(given)] = given
    return values


def got_up_again(recording: Recording) -> bool:
    """Whether the robot sat down and went on: from then on nobody knows an action's tick."""
    return any(said["verb"] == "stand" for said in recording.operator)


def action_unit(world: World, i: int) -> str:
    """Unit of a dimension of the task's actions: velocities x, y, yaw of the base, else angles."""
    velocities = tuple(world.task.actions.velocities)
    if i not in velocities:
        return "rad"
    return "m/s" if velocities.index(i) < 2 else "rad/s"


def parameter_columns(world: World) -> list[tuple[str, str]]:
    """Name and unit of each number of the task's parameters, in their order."""
    return [
        (parameter.name if parameter.size == 1 else f"{parameter.name}.{i}", parameter.unit)
        for parameter in world.task.parameters
        for i in range(parameter.size)
    ]


def _commanded(recording: Recording, world: World, count: int) -> list[Column]:
    names, joints = world.task.actions.names, world.task.scene.robot.joints
    acted = () if got_up_again(recording) else recording.actions
    actions = aligned(acted, count, len(names))
    targets = aligned(recording.targets, count, len(joints))
    return [
        *(
            Column(f"action.{name}", action_unit(world, i), "action of the plan", actions[:, i])
            for i, name in enumerate(names)
        ),
        *(
            Column(f"target.{name}", "rad", "joint target that was sent", targets[:, i])
            for i, name in enumerate(joints)
        ),
    ]


def _costs(recording: Recording, plans: np.ndarray) -> list[Column]:
    """Cost of the plan that is followed, whole and by term."""
    names = recording.config["terms"]
    terms = np.vstack([_rows(recording.terms).reshape(-1, len(names)), np.full(len(names), np.nan)])
    about = "weighted cost of the followed plan's candidate without noise"
    return [
        Column("cost", "1", about, terms[plans].sum(axis=1)),
        *(Column(f"cost.{name}", "1", about, terms[plans, i]) for i, name in enumerate(names)),
    ]


def _each(kind: str, about: str, names: Sequence[str], rows: Sequence[np.ndarray]) -> list[Column]:
    values = _rows(rows).reshape(-1, len(names))
    return [Column(f"{kind}.{name}", "1", about, values[:, i]) for i, name in enumerate(names)]


def _knots(recording: Recording, world: World) -> list[Column]:
    knots, actions = _rows(recording.knots), world.task.actions
    if knots.ndim != 3:
        return []
    about = "knot of the plan: in [-1, 1] over the range of its action"
    return [
        Column(f"knot.{k}.{actions.names[dim]}", "1", about, knots[:, k, n])
        for k in range(knots.shape[1])
        for n, dim in enumerate(actions.searched)
    ]


def _rows(rows: Sequence[np.ndarray]) -> np.ndarray:
    return np.array(rows)
