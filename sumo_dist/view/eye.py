"""From where a scene is looked at: the side from which nothing hides the robot."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.model.visible import VISIBLE_GROUPS

_STEP = 15.0  # between the sides that are tried [deg]


@dataclass(frozen=True)
class Shot:
    """A scene to look at.

    Attributes:
        qpos: (nq,) of the scene.
        target: (3,) what the eye looks at, world [m].
        distance: of the eye from it [m].
    """

    qpos: np.ndarray
    target: np.ndarray
    distance: float


def clearest_azimuth(
    model: mujoco.MjModel, base: str, shots: Iterable[Shot], elevation: float, preferred: float
) -> float:
    """Return the side from which most of the robot is seen over some shots [deg].

    Of sides that are as good the one next to the preferred is taken.

    Args:
        model: of the scene.
        base: body of the robot that all others of it hang on.
        shots: some moments of what is to be seen.
        elevation: of the eye, seen from its target [deg].
        preferred: a side, as all of them in the floor's plane [deg].
    """
    turns = np.arange(0.0, 180.0 + _STEP, _STEP)
    offsets = [0.0, *(sign * turn for turn in turns[1:-1] for sign in (1, -1)), 180.0]
    data = mujoco.MjData(model)
    seen = np.zeros(len(offsets), int)
    for shot in shots:
        data.qpos[:] = shot.qpos
        mujoco.mj_kinematics(model, data)
        for i, offset in enumerate(offsets):
            eye = shot.target + shot.distance * direction(preferred + offset, elevation)
            seen[i] += _seen(model, data, model.body(base).id, eye)
    return preferred + offsets[int(np.argmax(seen))]  # the first of those that are as good


def direction(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector (3,) from a target to an eye; both angles in [deg]."""
    around, up = np.deg2rad([azimuth, elevation])
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])


def _seen(model: mujoco.MjModel, data: mujoco.MjData, base: int, eye: np.ndarray) -> int:
    """Count the robot's bodies that an eye (3,) sees, itself in the way or not."""
    drawn = np.arange(mujoco.mjNGROUP) < VISIBLE_GROUPS
    own = model.body_rootid == model.body_rootid[base]
    hit, count = np.zeros(1, np.int32), 0
    for body in np.flatnonzero(own):
        ray = data.xpos[body] - eye
        reach = mujoco.mj_ray(model, data, eye, ray, drawn.astype(np.uint8), 1, -1, hit)
        free = reach < 0 or reach >= 1.0  # in lengths of the ray
        count += bool(free or own[model.geom_bodyid[hit[0]]])
    return count
