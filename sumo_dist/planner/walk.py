"""A walk that pushes: the robot goes behind an object and brings it straight to where it should be.

All of it is seen from above. Vectors on the floor are complex numbers x + iy, and a heading is one
of length 1: v * heading turns v from the robot's frame into the world's.
"""

import cmath
import math
from dataclasses import dataclass

import numpy as np

from sumo_dist.timing import TICK

AT_GOAL = 1e-3  # nearer than this the object needs no push [m]
STRIDE = 0.2  # on the circle round the object, how far ahead the point is that it heads for [rad]


@dataclass(frozen=True)
class Ground:
    """Robot and object as they stand [m].

    Attributes:
        base, heading: of the robot.
        centre: of the object's mass.
        way: from where the object is to where it should be.
        back: from the object's centre to its rear, seen along the way.
        width: of the object, across the way.
        reach: from the robot's base to its front, at the heights of the object.
        keep: from the robot's base to the object's centre while it goes round.
    """

    base: complex
    heading: complex
    centre: complex
    way: complex
    back: float
    width: float
    reach: float
    keep: float


@dataclass(frozen=True)
class Gait:
    """What the base can do.

    Attributes:
        lower, upper: limits of its velocities x, y and yaw [m/s, m/s, rad/s].
        settling: in how many seconds it slows down where the object should be [s].
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    settling: float

    def fastest(self, direction: complex) -> float:
        """Speed that it can have in a direction, of length 1, of its own frame [m/s]."""
        parts = zip((direction.real, direction.imag), self.lower, self.upper, strict=False)
        return min(
            max(0.0, (high if part > 0 else low) / part) for part, low, high in parts if part
        )

    def turn(self, angle: float) -> float:
        """Yaw rate that turns by an angle [rad] within a tick, or the nearest that it can have."""
        return min(max(angle / TICK, self.lower[2]), self.upper[2])


def walk(ground: Ground, gait: Gait, ticks: int) -> np.ndarray:
    """Velocities x, y and yaw, (ticks, 3), of the base that goes behind the object and pushes it.

    It is a point that has its velocities at once, and the object moves where it is pushed: what
    lags, slips or turns away the rollouts know.
    """
    velocities = np.zeros((ticks, 3))
    base, heading, centre, left = ground.base, ground.heading, ground.centre, abs(ground.way)
    if left < AT_GOAL:
        return velocities
    along = ground.way / left
    for tick in range(ticks):
        behind = (base - centre) / -along  # x: behind the object, y: beside the line of the push
        gap = behind.real - ground.back - ground.reach
        pushes = behind.real > 0.0 and abs(behind.imag) <= ground.width / 4
        if pushes:
            aim, facing = along * (max(gap, 0.0) + left + 1j * behind.imag), along
        else:
            aim, facing = _round(base - centre, along, ground.keep), centre - base
        direction = aim / abs(aim) / heading if aim else 1.0 + 0.0j
        speed = min(gait.fastest(direction), abs(aim) / gait.settling if pushes else math.inf)
        turn = gait.turn(cmath.phase(facing / heading))
        velocities[tick] = speed * direction.real, speed * direction.imag, turn
        step = speed * direction * heading * TICK
        base += step
        heading *= cmath.rect(1.0, turn * TICK)
        if pushes and gap <= 0.0:
            pushed = min((step / along).real, left)
            centre, left = centre + along * pushed, left - pushed
    return velocities


def _round(place: complex, along: complex, keep: float) -> complex:
    """Where to go from a place, relative to the object's centre, to come behind it.

    It is the shortest way round a circle: on a tangent up to it, then along it.
    """
    angle = cmath.phase(place / -along)
    tangent = math.acos(min(1.0, keep / abs(place))) if place else 0.0
    ahead = max(abs(angle) - tangent - STRIDE, 0.0)
    return cmath.rect(keep, math.copysign(ahead, angle)) * -along - place
