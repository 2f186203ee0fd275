"""A recording as MCAP, which Foxglove and its like open: frames, scene, joints, plans, events."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sumo_dist.export import schemas
from sumo_dist.export.columns import aligned, parameter_columns
from sumo_dist.export.shapes import (
    WORLD,
    color,
    entities,
    entity,
    frame,
    pose,
    quaternion,
    vector,
)
from sumo_dist.extras import need
from sumo_dist.model.index import StateIndex
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World
from sumo_dist.timing import TICK

_TICK_NS = round(TICK * 1e9)
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_GOAL = np.array([0.25, 0.88, 0.55, 0.8])

Message = tuple[int, str, dict[str, Any]]
"""Tick, topic and content."""


def write_mcap(recording: Recording, path: Path) -> None:
    """Write an MCAP file, whose time 0 is the start of the run.

    Raises:
        SumoError: the `export` extra is not installed.
    """
    need("export", "an MCAP file")
    from mcap.writer import Writer

    world = World.of(recording)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="sumo-dist")
        channels = {}
        for topic, (name, schema) in schemas.TOPICS.items():
            about = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
            channels[topic] = writer.register_channel(topic, "json", about)
        writer.add_metadata("sumo-dist", {"config": json.dumps(recording.config)})
        for number, (tick, topic, content) in enumerate(_messages(recording, world)):
            writer.add_message(
                channel_id=channels[topic],
                log_time=tick * _TICK_NS,
                data=json.dumps(content, separators=(",", ":"), allow_nan=False).encode(),
                publish_time=tick * _TICK_NS,
                sequence=number,
            )
        writer.finish()


def _messages(recording: Recording, world: World) -> Iterator[Message]:
    """Yield all messages, in the order of time."""
    plans, said = _plans(recording, world), [*recording.operator]
    plan = next(plans, None)
    yield 0, "/scene", {"deletions": [], "entities": entities(world.model)}
    bodies = _Bodies(recording, world)
    for tick, state in enumerate(recording.states):
        yield from bodies.at(tick, state)
        while said and said[0]["tick"] <= tick:
            yield tick, "/events", _log(tick, _said(said.pop(0)))
        while plan is not None and plan[0] <= tick:
            yield from _planned(plan, world)
            plan = next(plans, None)
    last = len(recording.states) - 1
    yield last, "/events", _log(last, f"the run has ended: {recording.ending or 'it ends here'}")


class _Bodies:
    """Where the bodies and joints of a run are, tick by tick."""

    def __init__(self, recording: Recording, world: World) -> None:
        self._model, self._data = world.model, mujoco.MjData(world.model)
        self._joints = StateIndex(world.model).columns
        self._driven = world.task.scene.robot.joints
        self._targets = aligned(recording.targets, len(recording.states), len(self._driven))

    def at(self, tick: int, state: np.ndarray) -> Iterator[Message]:
        """Yield the frames and joints of a tick."""
        model, data = self._model, self._data
        data.qpos[:] = state[: model.nq]
        mujoco.mj_kinematics(model, data)
        transforms = [
            {
                "timestamp": _stamp(tick),
                "parent_frame_id": WORLD,
                "child_frame_id": frame(model, body),
                "translation": vector(data.xpos[body]),
                "rotation": quaternion(data.xquat[body]),
            }
            for body in range(1, model.nbody)
        ]
        yield tick, "/tf", {"transforms": transforms}
        targets = dict(zip(self._driven, self._targets[tick], strict=True))
        joints = {
            name: {
                "position": float(state[in_qpos]),
                "velocity": float(state[in_qvel]),
                "target": _number(targets.get(name, np.nan)),
            }
            for name, (in_qpos, in_qvel) in self._joints.items()
        }
        yield tick, "/joints", {"timestamp": _stamp(tick), "joints": joints}


def _plans(recording: Recording, world: World) -> Iterator[tuple[int, dict[str, Any], np.ndarray]]:
    """Yield tick, content and parameters of each plan."""
    terms, names = recording.config["terms"], [name for name, _ in parameter_columns(world)]
    for i, tick in enumerate(recording.plan_ticks):
        costs = recording.costs[i]
        finite = costs[np.isfinite(costs)]
        content = {
            "timestamp": _stamp(int(tick)),
            "number": int(recording.plan_numbers[i]),
            "wall_ms": float(recording.plan_ms[i]),
            "age_ms": float(recording.age_ticks[i]) * TICK * 1e3,
            "rollouts": int(recording.rollouts[i]),
            "lost": int(recording.lost[i]),
            "best": _number(finite.min() if len(finite) else np.nan),
            "median": _number(np.median(finite) if len(finite) else np.nan),
            "total": float(recording.terms[i].sum()),
            "terms": dict(zip(terms, recording.terms[i].tolist(), strict=True)),
            "weights": dict(zip(terms, recording.weights[i].tolist(), strict=True)),
            "parameters": dict(zip(names, recording.parameters[i].tolist(), strict=True)),
        }
        yield int(tick), content, recording.parameters[i]


def _planned(plan: tuple[int, dict[str, Any], np.ndarray], world: World) -> Iterator[Message]:
    """Yield a plan, and its goal."""
    tick, content, parameters = plan
    yield tick, "/plan", content
    goal = world.task.goal_position(world.task.table.named(parameters))
    if goal is not None:
        size, look = vector(np.full(3, 0.08)), color(_GOAL)
        ball = {"pose": pose(goal, _UPRIGHT), "size": size, "color": look}
        goals = [entity("goal", WORLD, {"spheres": [ball]})]
        yield tick, "/goal", {"deletions": [], "entities": goals}


def _said(command: dict[str, Any]) -> str:
    name = f"{command['name']}=" if command["name"] else ""
    return f"{command['verb']} {name}{command['value']} by {command['sender']}"


def _log(tick: int, text: str) -> dict[str, Any]:
    about = {"timestamp": _stamp(tick), "level": schemas.INFO, "message": text}
    return {**about, "name": "sumo-dist", "file": "", "line": 0}


def _stamp(tick: int) -> dict[str, int]:
    sec, nsec = divmod(tick * _TICK_NS, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def _number(value: Any) -> float | None:
    """Return a number as JSON has it, None for none."""
    return float(value) if np.isfinite(value) else None
