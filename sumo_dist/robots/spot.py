"""Spot with its arm: stance, the policy's 25-d command, and the planner's action space."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sumo_dist.errors import unknown
from sumo_dist.policies.spot_layout import (
    ARM_JOINTS,
    COMMAND_ARM,
    COMMAND_BASE,
    COMMAND_FRONT_LEFT,
    COMMAND_FRONT_RIGHT,
    COMMAND_GRIPPER,
    COMMAND_PITCH_HEIGHT,
    JOINTS,
    LEG_JOINTS,
)
from sumo_dist.robots.robot import ActionSpace, Robot
from sumo_dist.robots.safety import Safety

GRIPPER_OPEN, GRIPPER_CLOSED = -1.54, 0.0
STANDING = (0.12, 0.72, -1.45, -0.12, 0.72, -1.45) * 2
SITTING = (0.48, 1.26, -2.7929, -0.48, 1.26, -2.7929) * 2
ARM_UNSTOWED = (0.0, -0.9, 1.8, 0.0, -0.9, 0.0)
ARM_STOWED = (0.0, -3.11, 3.13, 1.56, 0.0, -1.56)
STAND_HEIGHT = 0.52
LEFT_LEG, RIGHT_LEG = -0.5, 0.5  # leg selections below and above command that front leg (paper)

# Positions: the joints' own. Rates bound how far a target may jump between two policy steps (which
# the servos' torque limits turn into motion): in runs of box, tire, chair and rack the policy asked
# for up to 28 rad/s of a hip, 57 of a knee and 22 of the arm. The gripper may close in one step.
# Spot itself faults at 40 rad/s of a joint; those runs came to 21.
_SAFETY = Safety(
    target_lower=(
        *(-0.785398, -0.898845, -2.7929) * 4,
        *(-2.617993878, -3.141592654, 0.0, -2.792526803, -1.832595715, -2.879793266, -1.57),
    ),
    target_upper=(
        *(0.785398, 2.29511, -0.2471) * 4,
        *(3.141592654, 0.523598776, 3.141592654, 2.792526803, 1.832595715, 2.879793266, 0.0),
    ),
    target_rate=((40.0, 40.0, 70.0) * 4 + (30.0,) * 6 + (80.0,)),
    joint_speed=30.0,
    # The legs at once, before the motion can roll the body over them; the arm slowly, since its
    # mass would (tests/episode/test_safety.py, docs/decisions/0008).
    stop_s=(0.2,) * 12 + (1.2,) * 7,
)

SPOT = Robot(
    name="spot",
    mjcf="robots/spot.xml",
    base="body",
    joints=JOINTS,
    stand=(*STANDING, *ARM_UNSTOWED, GRIPPER_CLOSED),
    stand_height=STAND_HEIGHT,
    sit=(*SITTING, *ARM_STOWED, GRIPPER_CLOSED),
    fall_height=0.35,
    policy="spot",
    default_command=(
        *(0.0, 0.0, 0.0, *ARM_UNSTOWED, GRIPPER_CLOSED),
        *(0.0,) * 12,
        *(0.0, 0.0, STAND_HEIGHT),
    ),
    safety=_SAFETY,
)


@dataclass(frozen=True)
class _Limb:
    """A group of action dimensions."""

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    default: tuple[float, ...]


_LIMBS = {
    "base": _Limb(("base_vx", "base_vy", "base_wz"), (-0.7,) * 3, (0.7,) * 3, (0.0,) * 3),
    "arm": _Limb(
        ARM_JOINTS[:6],
        (-1.0, -1.9, 1.0, -np.pi / 2, -1.6, -np.pi / 4),
        (1.0, -0.1, 2.4, np.pi / 2, 0.0, np.pi / 4),
        ARM_UNSTOWED,
    ),
    # The default lies in the half that closes: at 0 the gripper would hang open.
    "gripper": _Limb(("gripper",), (-1.0,), (1.0,), (0.5,)),
    "legs": _Limb(
        (*LEG_JOINTS[:6], "leg_selection"),
        (*(-0.6, -0.8, -2.7) * 2, -1.0),
        (*(0.6, 1.65, -0.3) * 2, 1.0),
        (*STANDING[:6], 0.0),
    ),
    "torso": _Limb(("torso_pitch", "torso_height"), (-1.0, 0.3), (1.0, 1.0), (0.0, STAND_HEIGHT)),
}

EVEN: Mapping[str, float] = {}  # the same noise of all limbs


def spot_actions(
    arm: bool = True,
    gripper: bool = False,
    legs: bool = False,
    torso: bool = False,
    noise: Mapping[str, float] = EVEN,
) -> ActionSpace:
    """Build Spot's action space: base velocity and what else is asked for, in this order.

    What is left out has no dimension; its command is the robot's default: the arm as in the stance
    (a step from there to the stowed arm would topple the robot), gripper closed, legs to the
    policy, torso level at 0.52 m. The torso's roll is never searched. A gripper action above 0
    closes the gripper, any other opens it. Leg selection s < -0.5 commands the front left leg,
    s > 0.5 the front right one, any other value none (paper, section on the action space).

    Args:
        arm: six arm joint targets [rad].
        gripper: closed or open.
        legs: joint targets of the front legs [rad] and which of the two is commanded.
        torso: pitch [rad] and height [m].
        noise: of the search by limb, over that of the planner's settings, such as {"arm": 0.5}.

    Raises:
        UsageError: noise names what is no limb of the space.
    """
    wanted = {"base": True, "arm": arm, "gripper": gripper, "legs": legs, "torso": torso}
    limbs = {name: limb for name, limb in _LIMBS.items() if wanted[name]}
    if strange := [name for name in noise if name not in limbs]:
        raise unknown("limb of noise", strange[0], limbs)
    ends = np.cumsum([len(limb.names) for limb in limbs.values()])
    columns = dict(zip(limbs, np.split(np.arange(ends[-1]), ends[:-1]), strict=True))
    padding = np.array(SPOT.default_command)

    def to_command(action: np.ndarray) -> np.ndarray:
        command = np.broadcast_to(padding, (*action.shape[:-1], len(padding))).copy()
        parts = {name: action[..., chosen] for name, chosen in columns.items()}
        command[..., COMMAND_BASE] = parts["base"]
        if arm:
            command[..., COMMAND_ARM] = parts["arm"]
        if gripper:
            closes = parts["gripper"] > 0
            command[..., COMMAND_GRIPPER] = np.where(closes, GRIPPER_CLOSED, GRIPPER_OPEN)
        if legs:
            left, right, selection = np.split(parts["legs"], [3, 6], axis=-1)
            command[..., COMMAND_FRONT_LEFT] = np.where(selection < LEFT_LEG, left, 0.0)
            command[..., COMMAND_FRONT_RIGHT] = np.where(selection > RIGHT_LEG, right, 0.0)
        if torso:
            command[..., COMMAND_PITCH_HEIGHT] = parts["torso"]
        return command

    return ActionSpace(
        names=sum((limb.names for limb in limbs.values()), ()),
        lower=np.concatenate([limb.lower for limb in limbs.values()]),
        upper=np.concatenate([limb.upper for limb in limbs.values()]),
        default=np.concatenate([limb.default for limb in limbs.values()]),
        to_command=to_command,
        velocities=tuple(columns["base"].tolist()),
        noise=np.concatenate([[noise.get(n, 1.0)] * len(limb.names) for n, limb in limbs.items()]),
    )
