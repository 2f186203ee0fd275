"""Names and units of the numbers of a state, for people and for tables."""

from typing import NamedTuple

import mujoco

from sumo_dist.model.index import label

_Joint = mujoco.mjtJoint
_POSITION = (*((axis, "m") for axis in "xyz"), *((f"q{axis}", "1") for axis in "wxyz"))
_VELOCITY = (*((f"v{axis}", "m/s") for axis in "xyz"), *((f"w{axis}", "rad/s") for axis in "xyz"))


class Coordinate(NamedTuple):
    """One number of a state.

    Attributes:
        name: "THING.what": a free body's x, y, z in the world, its quaternion qw, qx, qy, qz, its
            linear velocity vx, vy, vz in the world and its angular one wx, wy, wz in its own frame;
            a joint's q and v.
        unit: of the number.
    """

    name: str
    unit: str


def coordinates(model: mujoco.MjModel) -> list[Coordinate]:
    """Return names and units of a state (nq + nv,): those of qpos, then those of qvel."""
    positions, velocities = list[Coordinate](), list[Coordinate]()
    for joint in range(model.njnt):
        kind = _Joint(model.jnt_type[joint])
        free = kind == _Joint.mjJNT_FREE
        thing = label(model, *(("body", model.jnt_bodyid[joint]) if free else ("joint", joint)))
        length = "m" if kind == _Joint.mjJNT_SLIDE else "rad"
        if free:
            of_qpos, of_qvel = _POSITION, _VELOCITY
        elif kind == _Joint.mjJNT_BALL:
            of_qpos, of_qvel = _POSITION[3:], _VELOCITY[3:]
        else:
            of_qpos, of_qvel = (("q", length),), (("v", f"{length}/s"),)
        positions += [Coordinate(f"{thing}.{what}", unit) for what, unit in of_qpos]
        velocities += [Coordinate(f"{thing}.{what}", unit) for what, unit in of_qvel]
    return positions + velocities
