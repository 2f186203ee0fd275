"""G1, a humanoid of 29 joints: stance, the policy's 19-d command, and the action space."""

from collections.abc import Sequence

import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.policies.g1_layout import (
    ARM,
    ARM_SIZE,
    COMMAND_ARMS,
    COMMAND_BASE,
    COMMAND_FOLLOWS,
    JOINT_OFFSETS,
    JOINTS,
    LEFT_ARM_OFFSETS,
    RIGHT_ARM_OFFSETS,
    SIDES,
)
from sumo_dist.robots.robot import ActionSpace, Robot, written_into
from sumo_dist.robots.safety import Safety

# The safe stop: legs folded, arms ahead. Of the poses that were tried it is the one from which the
# head falls slowest.
FOLDED_LEG = (-2.0, 0.0, 0.0, 2.4, -0.8, 0.0)
ARMS_AHEAD = tuple(q for roll in (0.2, -0.2) for q in (-1.2, roll, 0.0, 0.6, 0.0, 0.0, 0.0))

# The policy is sure-footed within these [m/s, rad/s]; below the layout's STAND_BELOW it stands.
BASE_LIMITS = (0.8, 0.4, 0.5)
# An arm may be this far from its default [rad]: so far the policy stays up (bench policy), and no
# joint is at its end.
ARM_REACH = 1.0

# What `sumo-dist bench safety --robot g1 RUN...` saw of random walks and of all four tasks:
# targets changed by up to 13 rad/s in a leg, 6 in the waist and 17 in an arm, and no joint was
# faster than 9 rad/s. Positions are the servos' ranges. Nobody can balance on two legs without a
# state, so the safe stop is a fall: short, so that it begins low, and it needs time to come to
# rest. It does not get up by itself.
_SAFETY = Safety(
    target_rate=((30.0,) * 12 + (15.0,) * 3 + (40.0,) * 14),
    joint_speed=25.0,
    stop_s=0.5,
    rest_s=2.0,
    rise_tilt=0.0,
)

G1 = Robot(
    name="g1",
    mjcf="robots/g1.xml",
    base="pelvis",
    joints=JOINTS,
    stand=JOINT_OFFSETS,
    stand_height=0.76,
    sit=(*FOLDED_LEG * 2, 0.0, 0.0, 0.2, *ARMS_AHEAD),
    fall_height=0.6,
    policy="g1",
    default_command=(0.0, 0.0, 0.0, *LEFT_ARM_OFFSETS, *RIGHT_ARM_OFFSETS, 0.0, 0.0),
    safety=_SAFETY,
)


def g1_actions(arms: Sequence[str] = (), reach: float = ARM_REACH) -> ActionSpace:
    """Build G1's action space: base velocity, and shoulder and elbow of the arms asked for.

    An arm that is asked for follows its targets, the wrist at rest; any other one is the policy's.

    Args:
        arms: of "left" and "right", in this order.
        reach: how far each of their joints may be from its default [rad].

    Raises:
        UsageError: there is no such arm.
    """
    chosen = tuple(arms)
    if chosen not in ((), ("left",), ("right",), SIDES):
        raise UsageError(f"arms are (), ('left',), ('right',) or {SIDES}, not {chosen}")
    padding = np.array(G1.default_command)
    padding[COMMAND_FOLLOWS] = [side in chosen for side in SIDES]
    places = np.arange(len(padding))  # in the command
    arms_places = places[COMMAND_ARMS].reshape(len(SIDES), ARM_SIZE)[:, : len(ARM)]
    columns = np.concatenate(
        [places[COMMAND_BASE], *(arms_places[SIDES.index(side)] for side in chosen)]
    )  # where each action stands in the command
    default = padding[columns]
    width = np.array([*BASE_LIMITS, *[reach] * (len(ARM) * len(chosen))])
    names = [f"{side}_{joint}" for side in chosen for joint in ARM]
    return ActionSpace(
        names=("base_vx", "base_vy", "base_wz", *names),
        lower=default - width,
        upper=default + width,
        default=default,
        to_command=written_into(padding, columns),
        velocities=tuple(range(len(BASE_LIMITS))),
    )
