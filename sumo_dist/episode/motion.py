"""How a robot moved in an episode: what its motion would ask of hardware.

Everything is taken from the recording, tick by tick, so that any episode can be measured, also one
of a robot that nobody simulates.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
import numpy as np

from sumo_dist.record.recording import Recording
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK

STILL = 1e-6  # change of a target per tick that is none, in units of its range
POSES = 2000  # of an episode at most, in which contacts and forces are looked at


class Measure(NamedTuple):
    """One number of an episode's motion; the less of it, the easier on hardware.

    Attributes:
        title: with its unit, for tables.
        form: how it is printed.
    """

    title: str
    form: str


MEASURES = {
    "limb_reversals_hz": Measure("limb reversals [1/s]", "{:.1f}"),
    "limb_reversals_worst_hz": Measure("worst limb [1/s]", "{:.1f}"),
    "base_reversals_hz": Measure("base reversals [1/s]", "{:.1f}"),
    "target_jerk": Measure("target jerk [rad/s^3]", "{:.0f}"),
    "limb_jerk": Measure("limb jerk [rad/s^3]", "{:.0f}"),
    "joint_jerk": Measure("joint jerk [rad/s^3]", "{:.0f}"),
    "floor_penetration_mm": Measure("into floor [mm]", "{:.1f}"),
    "object_penetration_mm": Measure("into objects [mm]", "{:.1f}"),
    "work_j": Measure("work [J]", "{:.0f}"),
}


def measure(recording: Recording, task: Task, model: mujoco.MjModel) -> dict[str, float]:
    """Measure an episode.

    A reversal is a change of the direction in which a target moves. Targets are the actions that
    the robot followed, those of the base being velocities. They are counted per dimension: the
    mean over the limbs', the limb that reverses most often, and the mean over the base's. Jerk is
    the root mean square over ticks and joints: of the limbs' targets, of the joints that follow
    them, and of all the robot's joints, most of which is the gait's. The robot's deepest contacts
    are those with what does not move and with what does. Work is the integral of |torque x speed|
    over the joints.

    Args:
        recording: of the episode.
        task: that it was.
        model: of its scene, whose servos turn the recorded targets into torques.

    Returns:
        The numbers named in MEASURES; those that need more ticks than there are, are left out.
    """
    actions = task.actions
    is_base = np.isin(np.arange(len(actions.names)), actions.velocities)
    searched = np.isin(np.arange(len(actions.names)), actions.searched)
    width = np.where(searched, actions.upper - actions.lower, 1.0)
    changes = Changes(STILL * width)
    for action in recording.actions:
        changes.add(action)
    robot = Body.of(model, task.scene.robot.joints)
    joints = Differences(2)  # the second difference of a speed is a jerk
    for state in recording.states:
        joints.add(state[model.nq + robot.dofs])
    found = {
        **_of_targets(changes, searched & ~is_base, searched & is_base),
        "limb_jerk": joints.rms(_followers(task)) / TICK**2,
        "joint_jerk": joints.rms() / TICK**2,
        **_of_contacts(recording, robot),
    }
    return {name: round(float(value), 3) for name, value in found.items() if np.isfinite(value)}


def mean(rows: Iterable[dict[str, float]]) -> dict[str, float]:
    """Average each measure over those episodes that have it."""
    rows = list(rows)
    of = {name: [row[name] for row in rows if name in row] for name in MEASURES}
    return {name: float(np.mean(values)) for name, values in of.items() if values}


def _followers(task: Task) -> np.ndarray:
    """Which of the robot's joints follow a target of the plan, (nu,) bool."""
    targets = {task.actions.names[i] for i in task.actions.searched}
    return np.array(
        [
            name.removesuffix("_joint") in targets or name in targets
            for name in task.scene.robot.joints
        ]
    )


def _of_targets(changes: "Changes", limbs: np.ndarray, base: np.ndarray) -> dict[str, float]:
    """Reversals and jerk of the dimensions that are limbs' and of those that are the base's."""
    seconds = changes.count * TICK
    often = changes.reversals / seconds if seconds else np.full(len(limbs), np.nan)
    jerk = changes.jerk
    return {
        "limb_reversals_hz": often[limbs].mean() if limbs.any() else np.nan,
        "limb_reversals_worst_hz": often[limbs].max() if limbs.any() else np.nan,
        "base_reversals_hz": often[base].mean() if base.any() else np.nan,
        "target_jerk": jerk.rms(limbs) / TICK**3 if limbs.any() else np.nan,
    }


class Differences:
    """The mean square of the n-th differences of a signal that comes value by value."""

    def __init__(self, order: int) -> None:
        """Start with nothing."""
        self._kernel = np.array([1.0])
        for _ in range(order):
            self._kernel = np.convolve(self._kernel, [1.0, -1.0])
        self._last: list[np.ndarray] = []
        self._sum, self._count = np.zeros(0), 0

    def add(self, value: np.ndarray) -> None:
        """Take the next value (n,)."""
        self._last = [*self._last, value][-len(self._kernel) :]
        if len(self._last) == len(self._kernel):
            squared = np.square(self._kernel[::-1] @ np.array(self._last))
            self._sum = squared if not self._count else self._sum + squared
            self._count += 1

    def rms(self, which: np.ndarray | slice = slice(None)) -> float:
        """Root of the mean square over values and dimensions; nan if too few came."""
        squares = self._sum[which] if self._count else np.zeros(0)
        return float(np.sqrt(np.mean(squares / self._count))) if len(squares) else np.nan


@dataclass
class Changes:
    """Counts how often a signal (n,) changes its direction.

    Attributes:
        least: (n,) change from value to value that is one.
        reversals: (n,) counted so far.
        count: values that came.
        jerk: third differences of the signal.
    """

    least: np.ndarray
    count: int = 0
    jerk: Differences = field(default_factory=lambda: Differences(3))
    _last: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.reversals = np.zeros(len(self.least), int)
        self._direction = np.zeros(len(self.least))  # of the last change that was one

    def add(self, value: np.ndarray) -> None:
        """Take the next value."""
        if self._last is not None:
            change = value - self._last
            direction = np.where(np.abs(change) > self.least, np.sign(change), 0.0)
            self.reversals += direction * self._direction < 0
            self._direction = np.where(direction == 0, self._direction, direction)
        self._last = value
        self.count += 1
        self.jerk.add(value)


class Body(NamedTuple):
    """Where a robot is in a model.

    Attributes:
        model: of the scene.
        dofs: (nu,) of its actuated joints.
        bodies: (nbody,) bool, which bodies are its own.
        fixed: (nbody,) bool, which do not move.
    """

    model: mujoco.MjModel
    dofs: np.ndarray
    bodies: np.ndarray
    fixed: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel, joints: Sequence[str]) -> "Body":
        """Find the robot by its joints."""
        first = model.joint(joints[0])
        roots = model.body_rootid
        dofs = np.array([model.joint(name).dofadr[0] for name in joints])
        return cls(model, dofs, roots == roots[first.bodyid[0]], model.body_weldid == 0)


def _of_contacts(recording: Recording, robot: Body) -> dict[str, float]:
    """Depth of the robot's contacts [mm] and work of its joints [J], in at most POSES poses."""
    model, ticks = robot.model, min(len(recording.states), len(recording.targets))
    data, every = mujoco.MjData(robot.model), max(1, -(-ticks // POSES))
    floor = things = work = 0.0
    for tick, (state, targets) in enumerate(zip(recording.states, recording.targets, strict=False)):
        if tick % every or not np.isfinite(state).all():
            continue
        data.qpos[:], data.qvel[:] = np.split(state, [model.nq])
        data.ctrl[:] = targets
        mujoco.mj_forward(model, data)
        bodies = model.geom_bodyid[data.contact.geom]  # (contacts, 2)
        with_others = robot.bodies[bodies].sum(axis=1) == 1
        fixed = robot.fixed[bodies].any(axis=1)
        deep = -data.contact.dist
        floor = max(floor, deep[with_others & fixed].max(initial=0.0))
        things = max(things, deep[with_others & ~fixed].max(initial=0.0))
        work += np.abs(data.qfrc_actuator[robot.dofs] * data.qvel[robot.dofs]).sum() * every * TICK
    if not ticks:
        return {}
    return {
        "floor_penetration_mm": floor * 1e3,
        "object_penetration_mm": things * 1e3,
        "work_j": work,
    }
