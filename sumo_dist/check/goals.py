"""Check of where a task wants things: can they be there, and is it then solved."""

from itertools import product
from typing import NamedTuple

import mujoco
import numpy as np

from sumo_dist.check.findings import Finding
from sumo_dist.check.starts import ARENA, OVERLAP
from sumo_dist.check.subject import Subject
from sumo_dist.model.index import StateIndex
from sumo_dist.tasks.reset import upright


class Frame(NamedTuple):
    """What should come to the goal.

    Attributes:
        name: of the task's frame.
        root: the top-level body that carries it.
    """

    name: str
    root: str


def goal(subject: Subject) -> Finding:
    """Can the task's goal be reached: is there room, does it rest there, is it then solved."""
    task, table = subject.task, subject.task.table
    place = task.goal_position(table.named(table.defaults.parameters))
    if place is None:
        return Finding("ok", "the task names none")
    at = f"goal ({', '.join(f'{x:g}' for x in place)})"
    if (away := float(np.abs(place).max())) > ARENA:
        return Finding("fail", f"{at} is {away:.0f} m away; positions are in m")
    frame = Frame(task.goal_frame, _root(subject, task.goal_frame))
    if frame.root not in StateIndex(subject.plant).free_bodies:
        return Finding("ok", f"{at}; {frame.name} hangs on a fixture, it was not tried there")
    first = ""
    for level, start in product((False, True), subject.starts):
        reason = _unreachable(subject, _put(subject, start, frame, place, level), frame)
        if not reason:
            return Finding("ok", f"{at}: there {frame.name} rests, and success holds")
        first = first or reason
    return Finding("fail", f"{at}: {first}")


def _unreachable(subject: Subject, state: np.ndarray, frame: Frame) -> str:
    """Say why the world cannot stay at a state with the frame at its goal, "" if it can."""
    if reason := _blocked(subject, state, frame):
        return reason
    if frame.root != subject.task.scene.robot.base:
        rest = subject.world.settle(state)
        if rest.moved:
            return f"put there, {rest.moved}"
        state = rest.state
    success, failures = subject.referee.judge(state)
    if failures:
        return f"put there, {frame.name} makes the failure {failures[0]!r} hold"
    return "" if success else f"success does not hold while {frame.name} rests there"


def _put(
    subject: Subject, start: np.ndarray, frame: Frame, place: np.ndarray, level: bool
) -> np.ndarray:
    """State (nq + nv,) with what carries the frame moved so that the frame is at the goal.

    It has the attitude of its start, or is `level`. A robot keeps its height: it stands, wherever
    a viewer draws its goal.
    """
    state, index = start.copy(), StateIndex(subject.plant)
    if level:
        state[index.pose(frame.root)][3:] = upright(0.0)
    shift = place - subject.view(state)[frame.name].pos[0, 0]
    if frame.root == subject.task.scene.robot.base:
        shift[2] = 0.0
    state[index.pose(frame.root)][:3] += shift
    state[index.velocity(frame.root)] = 0.0
    return state


def _blocked(subject: Subject, state: np.ndarray, frame: Frame) -> str:
    """Say which of what cannot move away is where the carrier of the frame should be."""
    model, data = subject.plant, subject.simulation(state)
    root = model.body(frame.root).id
    free = {model.body(name).id for name in StateIndex(model).free_bodies}
    for contact in data.contact:
        roots = {int(model.body_rootid[model.geom_bodyid[geom]]) for geom in contact.geom}
        if root in roots and contact.dist < -OVERLAP and not (roots - {root}) & free:
            other = model.body(next(iter(roots - {root}), root)).name
            name = "the floor" if other in ("world", "floor") else other
            return f"put there, {frame.root} is {-contact.dist * 1e3:.0f} mm inside {name}"
    return ""


def _root(subject: Subject, name: str) -> str:
    """Name of the top-level body that carries a frame of the task."""
    ref, model = subject.task.frames[name], subject.plant
    is_site = ref.kind == "site"
    body = model.site(ref.name).bodyid[0] if is_site else model.body(ref.name).id
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, int(model.body_rootid[body])) or ""
