"""What Spot's tasks of grasping and letting go share: frames, terms, and the test of a delivery.

The costs as printed draw the robot to a thing for good: one that stands is held, and no test on its
speed is ever passed. So a term that draws is off once the thing is done (`until`), and what is left
then costs its motion and the robot's nearness (`once`); docs/decisions/0025.
"""

import numpy as np

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.robots.spot import GRIPPER_CLOSED, SPOT
from sumo_dist.tasks import terms
from sumo_dist.tasks.spot.families import (
    SUCCESS_RADIUS,
    SUCCESS_SPEED,
    SUCCESS_TILT,
    WORKSPACE,
    Standing,
)
from sumo_dist.tasks.success import AllBelow, Measure
from sumo_dist.tasks.terms import TIPPED, Predicate, Residual

HOLD = 0.5  # how long a thing must be as it should, since it may pass through [s]
JAW = "arm_f1x"  # the gripper's joint, 0 closed and -1.54 open [rad]
OBSTRUCTED = 0.15  # a jaw this far from where it is sent to is around something (paper) [rad]
SHUT = 0.05  # a jaw this near to closed has nothing in it (released code) [rad]
RESTS = 0.5  # a faster jaw is still on its way [rad/s]
OPEN_JAW = -0.5  # the gripper's action while the robot waits: well within the half that opens
GRASP_WEIGHT = -100.0  # paper
EMPTY_WEIGHT = 200.0  # of the share of the rollout; the paper's 1000 for any of it forbids to try

FRAMES = {
    "gripper": FrameRef("site", "site_arm_link_fngr"),
    "wrist": FrameRef("site", "site_arm_link_wr1"),
}
# Below the paper's 0.35 m a robot sprawls, and hardly gets up again: by the share of the rollout,
# so that getting up pays. A fall weighs what the released code's tire tasks have: at the paper's
# 2500 it could pay to fall, if that sets the object upright.
LOW = CostTerm("low", terms.low(SPOT), 2500.0, "share")
FALL = CostTerm("fall", terms.lies(SPOT), 10000.0, "any")


def dot(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Inner product over the last axis, (..., 3) each, summed in a fixed order."""
    return one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1] + one[..., 2] * other[..., 2]


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., n) at length 1; those that have none stay 0."""
    return vectors / np.maximum(norm(vectors), 1e-6)[..., None]


def until(done: Predicate, residual: Residual) -> Residual:
    """Return a residual that is 0 where something is done."""
    return lambda r: np.where(done(r), 0.0, residual(r))


def once(done: Predicate, residual: Residual) -> Residual:
    """Return a residual that is 0 where something is not done yet."""
    return lambda r: np.where(done(r), residual(r), 0.0)


def nearest(frame: str, *targets: str) -> Residual:
    """Distance of a frame from the nearest of some others [m]."""

    def distance(r: View) -> np.ndarray:
        least = norm(r[frame].pos - r[targets[0]].pos)
        for target in targets[1:]:
            least = np.minimum(least, norm(r[frame].pos - r[target].pos))
        return least

    return distance


def within(reach: float, distance: Residual) -> Residual:
    """How much nearer something is than a reach [m]."""
    return lambda r: np.maximum(0.0, reach - distance(r))


def base_speed(r: View) -> np.ndarray:
    """Velocity asked of the base, (B, T) [m/s, rad/s]."""
    return norm(r.actions[..., :3])


def squared_speed(frame: str) -> Residual:
    """Squared speed of a free body [m^2/s^2]."""
    return lambda r: dot(r[frame].linvel, r[frame].linvel)


def spinning(frame: str) -> Residual:
    """Angular speed of a free body, at most 2 rad/s: one blow counts no more than another."""
    return lambda r: np.minimum(norm(r[frame].angvel), 2.0)


def lying(sharpness: float) -> Residual:
    """1 - exp(sharpness (z_obj . z - 1)): 0 upright, about 1 from lying on (paper)."""
    return lambda r: 1.0 - np.exp(sharpness * (r.object.z[..., 2] - 1.0))


def stands(standing: Standing) -> Predicate:
    """Whether the object is as near to upright as success asks for."""
    return lambda r: standing.tilt(r) < r.p.success_tilt


def not_fallen(standing: Standing) -> Predicate:
    """Whether the object leans so little that it could come back by itself."""
    return lambda r: standing.tilt(r) < TIPPED


def at_goal(r: View) -> np.ndarray:
    """Whether the object is well within the radius that success asks for, (B, T) bool."""
    return terms.goal_distance("object")(r) < 0.75 * r.p.success_radius


def obstruction(r: View) -> np.ndarray:
    """How firmly the jaw is around something, (B, T) from 0 to 1.

    The paper prints q - c and calls it positive when an object keeps the jaw from closing; with
    Spot's angles, 0 closed and -1.54 open, that is c - q. A jaw that still moves counts for
    nothing, else it would pay to snap at the air.
    """
    jaw = r.joints[JAW]
    error = jaw.target - jaw.pos
    holds = (error > OBSTRUCTED) & (jaw.pos < -SHUT) & (np.abs(jaw.vel) < RESTS)
    return np.where(holds, np.minimum(error / 0.5, 1.0), 0.0)


def empty(r: View) -> np.ndarray:
    """Whether the jaw has closed on nothing, (B, T) bool."""
    jaw = r.joints[JAW]
    return (jaw.pos > -SHUT) & (jaw.target > GRIPPER_CLOSED - SHUT)


def grasp_terms(done: Predicate) -> tuple[CostTerm, CostTerm]:
    """Build the terms of a grasp that is firm, and of one that closed on nothing (paper).

    Args:
        done: a grasp is worth nothing any more once this holds.
    """
    return (
        CostTerm("grasp", until(done, obstruction), GRASP_WEIGHT),
        CostTerm("empty", empty, EMPTY_WEIGHT, "share"),
    )


def delivery_test(standing: Standing) -> AllBelow:
    """Return the test of an object that stands at rest at its goal on the floor."""
    return AllBelow(
        Measure("object to goal", terms.goal_distance("object"), "success_radius"),
        Measure("object's speed", terms.speed("object"), "success_speed"),
        Measure("object's tilt", standing.tilt, "success_tilt"),
    )


DELIVERY = (
    Parameter("goal", (0.0, 0.0), "m", (-WORKSPACE, WORKSPACE)),
    Parameter("success_radius", 2 * SUCCESS_RADIUS, "m", (0.0, 1.0)),
    Parameter("success_speed", SUCCESS_SPEED, "m/s", (0.0, 1.0)),
    Parameter("success_tilt", 2 * SUCCESS_TILT, "rad", (0.0, np.pi / 4)),
)
