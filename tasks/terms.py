"""Residuals that all tasks share, by the names of the task's frames; each View -> (B, T)."""

from collections.abc import Callable

import numpy as np

from sumo_dist.costs.terms import norm
from sumo_dist.costs.view import View
from sumo_dist.robots.robot import Robot

TIPPED = np.pi / 4  # beyond this tilt an object does not come back by itself [rad]
FALL_TILT = np.cos(np.pi / 3)  # z of the base's up axis: below it the robot lies on its side
FALL_WEIGHT = 2500.0  # paper: of a rollout in which the robot falls

Residual = Callable[[View], np.ndarray]
Predicate = Callable[[View], np.ndarray]
"""View -> (B, T) bool."""


def distance(one: str, other: str) -> Residual:
    """Distance between two frames [m]."""
    return lambda r: norm(r[one].pos - r[other].pos)


def goal_distance(frame: str, z: float | None = None) -> Residual:
    """Distance of a frame from the parameter `goal` (x, y) [m].

    Args:
        frame: the frame.
        z: height of the goal [m]; None measures on the floor.
    """
    if z is None:
        return lambda r: norm(r[frame].pos[..., :2] - r.p.goal)
    return lambda r: norm(r[frame].pos - np.array([*r.p.goal, z]))


def speed(frame: str) -> Residual:
    """Speed of a free body [m/s]."""
    return lambda r: norm(r[frame].linvel)


def spin(frame: str) -> Residual:
    """Angular speed of a free body [rad/s]."""
    return lambda r: norm(r[frame].angvel)


def tipped(frame: str, tilt: float = TIPPED) -> Predicate:
    """Whether a frame's z axis leans further than a tilt [rad]."""
    return lambda r: r[frame].z[..., 2] < np.cos(tilt)


def outside(radius: float, *frames: str) -> Predicate:
    """Whether one of some frames is further from the origin than a radius [m]."""

    def left_workspace(r: View) -> np.ndarray:
        away = norm(r[frames[0]].pos) > radius
        for frame in frames[1:]:
            away = away | (norm(r[frame].pos) > radius)
        return away

    return left_workspace


def low(robot: Robot) -> Predicate:
    """Whether the robot's base is no higher than where it counts as fallen (paper, of G1)."""
    return lambda r: r.base.pos[..., 2] <= robot.fall_height


def lies(robot: Robot) -> Predicate:
    """Whether a robot lies: below its fall height on its side, or below half of it.

    Lifting a heavy thing, Spot crouches below the height, level and for seconds.
    """

    def lying(r: View) -> np.ndarray:
        height = r.base.pos[..., 2]
        on_its_side = r.base.z[..., 2] < FALL_TILT
        return (height <= robot.fall_height / 2) | ((height <= robot.fall_height) & on_its_side)

    return lying


def effort(default: np.ndarray) -> Residual:
    """Speed asked of the base plus distance of all other actions from their default.

    Args:
        default: (nu,) actions of a robot that stands; the first three are the base's velocities.
    """

    def asked(r: View) -> np.ndarray:
        speed = norm(r.actions[..., :3])
        if len(default) == 3:
            return speed
        return speed + norm(r.actions[..., 3:] - default[3:])

    return asked
