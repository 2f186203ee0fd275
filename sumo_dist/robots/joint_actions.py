"""Actions without a pretrained policy: joint targets, which the servos' gains hold."""

from collections.abc import Sequence

import numpy as np

from sumo_dist.errors import UsageError, unknown
from sumo_dist.robots.robot import ActionSpace, Robot, written_into

REACH = 0.5  # [rad]


def joint_actions(
    robot: Robot,
    joints: Sequence[str] | None = None,
    reach: float = REACH,
    around: Sequence[float] | None = None,
) -> ActionSpace:
    """Build the action space of some joints' targets; all others stay at their default.

    The command is that of `policies.hold`: the targets of all joints, (nu,) [rad]. Servos as soft
    as a policy's yield to the robot's weight: with the stance as its targets Spot sinks to half its
    height. `around` is for targets that hold the stance: those plus torque over stiffness.

    Args:
        robot: whose joints they are.
        joints: which of them, in the order of the actions; None for all.
        reach: how far a target may be from its default [rad], within the robot's safety limits;
            np.inf is these alone.
        around: the default targets of all joints, (nu,) [rad]; None for the stance.

    Raises:
        UsageError: there is no such joint, it is named twice, nothing limits it, or a default
            lies outside the safety limits.
    """
    places = _places(robot, robot.joints if joints is None else tuple(joints))
    targets = np.array(robot.stand if around is None else around, np.float64)
    if targets.shape != (len(robot.joints),):
        raise UsageError(
            f"joint actions around targets of shape {targets.shape}: robot {robot.name!r} "
            f"has {len(robot.joints)} joints"
        )
    lower, upper = _limits(robot, targets, reach)
    return ActionSpace(
        names=tuple(robot.joints[place] for place in places),
        lower=lower[places],
        upper=upper[places],
        default=targets[places],
        to_command=written_into(targets, places),
    )


def _places(robot: Robot, joints: tuple[str, ...]) -> np.ndarray:
    for joint in joints:
        if joint not in robot.joints:
            raise unknown("joint", joint, robot.joints)
    if not joints or len(set(joints)) != len(joints):
        raise UsageError(f"joint actions need joints, each once, not {joints}")
    return np.array([robot.joints.index(joint) for joint in joints])


def _limits(robot: Robot, targets: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    if not reach > 0.0:
        raise UsageError(f"joint actions: a reach of {reach} rad; it must be positive")
    lower = np.maximum(targets - reach, robot.safety.target_lower or -np.inf)
    upper = np.minimum(targets + reach, robot.safety.target_upper or np.inf)
    if not np.isfinite([lower, upper]).all():
        raise UsageError(f"robot {robot.name!r} states no limits of joint targets: give a reach")
    outside = np.flatnonzero((targets < lower) | (targets > upper))
    if len(outside):
        names = [robot.joints[i] for i in outside]
        raise UsageError(f"joint actions: default targets outside the safety limits: {names}")
    return lower, upper
