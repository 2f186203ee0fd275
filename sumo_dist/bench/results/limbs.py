"""`sumo-dist bench limbs`: what recorded trials did with the gripper, front legs and torso."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.journal import STANDING
from sumo_dist.costs.view import Joints, View
from sumo_dist.errors import UsageError
from sumo_dist.export.columns import aligned
from sumo_dist.model.index import StateIndex
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World
from sumo_dist.robots.spot import LEFT_LEG, RIGHT_LEG
from sumo_dist.tasks.spot.terms import obstruction

HEAD = (
    *("task", "trials", "jaw around something", "of the object's way", "left leg", "right leg"),
    *("torso height [m]", "torso pitch [rad]"),
)

LEAST = 1e-6  # a way of an object that counts as one [m]


@dataclass(frozen=True)
class Options:
    """Options of `bench limbs`.

    Attributes:
        folder: below which the recordings are, such as that of `bench suite --recordings all`.
    """

    folder: Annotated[Path, tyro.conf.Positional]


@dataclass(frozen=True)
class Use:
    """What one trial did; None of what the task does not search.

    Attributes:
        grip: share of the time that the jaw was around something.
        dragged: share of the object's way on the floor for which it was.
        left, right: share of the time that a front leg was commanded.
        height, pitch: of the torso as commanded, its least and largest [m], [rad].
    """

    grip: float | None = None
    dragged: float | None = None
    left: float | None = None
    right: float | None = None
    height: tuple[float, float] | None = None
    pitch: tuple[float, float] | None = None


def main(options: Options) -> int:
    """Print a row a task: means over its trials, and extremes of the torso."""
    found = sorted(
        path for path in options.folder.rglob("run.npz") if not path.parent.name.endswith(STANDING)
    )
    if not found:
        raise UsageError(f"{options.folder} holds no recordings: bench suite --recordings all")
    uses = [use(Recording.load(path)) for path in found]
    print(markdown(HEAD, list(rows(uses))))
    return 0


def rows(uses: list[tuple[str, Use]]) -> Iterator[list[str]]:
    """Lay out a row a task of (task, use)."""
    for task, of_it in itertools.groupby(sorted(uses, key=lambda pair: pair[0]), lambda p: p[0]):
        some = [pair[1] for pair in of_it]
        shares = [
            [getattr(one, name) for one in some] for name in ("grip", "dragged", "left", "right")
        ]
        spans = [[getattr(one, name) for one in some] for name in ("height", "pitch")]
        yield [
            *(task, str(len(some))),
            *("-" if None in share else f"{np.mean(share):.0%}" for share in shares),
            *(
                "-" if None in span else f"{np.min(span):.2f} to {np.max(span):.2f}"
                for span in spans
            ),
        ]


def use(recording: Recording) -> tuple[str, Use]:
    """Return a recording's task and what it did with its limbs."""
    world = World.of(recording)
    names, joints = world.task.actions.names, world.task.scene.robot.joints
    states = np.array(recording.states)
    actions = aligned(recording.actions, len(states), len(names))
    column = {name: actions[:, i] for i, name in enumerate(names)}
    done: dict[str, Any] = {}
    if "gripper" in column:
        index, targets = (
            StateIndex(world.model),
            aligned(recording.targets, len(states), len(joints)),
        )
        servos = {name: i for i, name in enumerate(joints)}
        jaw = Joints(states[None], targets[None], index.columns, servos)
        grips = obstruction(View({}, actions[None], joints=jaw))[0] > 0.0
        moved = np.linalg.norm(np.diff(states[:, index.pose(_mover(world))][:, :2], axis=0), axis=1)
        done |= {
            "grip": grips.mean(),
            "dragged": (moved * grips[1:]).sum() / max(moved.sum(), LEAST),
        }
    if "leg_selection" in column:
        chosen = column["leg_selection"]
        done |= {"left": (chosen < LEFT_LEG).mean(), "right": (chosen > RIGHT_LEG).mean()}
    for name, short in (("torso_height", "height"), ("torso_pitch", "pitch")):
        if name in column:
            done[short] = np.nanmin(column[name]), np.nanmax(column[name])
    return world.task.name, Use(**done)


def _mover(world: World) -> str:
    """The scene's object that is moved: the last, as a tire that is laid upon another."""
    return world.task.scene.objects[-1].name
