"""The layout of Spot's whole-body policy: joint names, orders, offsets, parts of the command.

Stated here once: the policy, the robot, its action space and the native engine take it from here.
"""

KIND = "spot_relic"
LEGS = ("fl", "fr", "hl", "hr")
LEG_SIZE = 3
LEG_JOINTS = tuple(f"{leg}_{joint}" for leg in LEGS for joint in ("hx", "hy", "kn"))
ARM_JOINTS = tuple(f"arm_{joint}" for joint in ("sh0", "sh1", "el0", "el1", "wr0", "wr1", "f1x"))
JOINTS = LEG_JOINTS + ARM_JOINTS  # the model's order

# fmt: off
NETWORK_JOINTS = (
    "arm_sh0", "fl_hx", "fr_hx", "hl_hx", "hr_hx",
    "arm_sh1", "fl_hy", "fr_hy", "hl_hy", "hr_hy",
    "arm_el0", "fl_kn", "fr_kn", "hl_kn", "hr_kn",
    "arm_el1", "arm_wr0", "arm_wr1", "arm_f1x",
)
# fmt: on
NETWORK_LEG_JOINTS = tuple(joint for joint in NETWORK_JOINTS if joint in LEG_JOINTS)

# network order[i] = model order[JOINTS_TO_NETWORK[i]]; leg targets[i] = action[ACTION_TO_LEGS[i]]
JOINTS_TO_NETWORK = tuple(JOINTS.index(joint) for joint in NETWORK_JOINTS)
ACTION_TO_LEGS = tuple(NETWORK_LEG_JOINTS.index(joint) for joint in LEG_JOINTS)

# What the network's joint positions and actions are relative to, in the model's order [rad]. The
# hips of left and right legs open outwards; the gripper's is its open position.
LEG_OFFSETS = (0.12, 0.5, -1.0, -0.12, 0.5, -1.0) * 2
JOINT_OFFSETS = (*LEG_OFFSETS, 0.0, -0.9, 1.8, 0.0, -0.9, 0.0, -1.54)
ACTION_SCALE = 0.2  # [rad] per unit of action

# The command: base velocity vx, vy [m/s], wz [rad/s]; arm and gripper [rad]; legs [rad], of which
# zeros leave a leg to the policy; torso roll, pitch [rad], height [m]. Joints in the model's order.
COMMAND_BASE = slice(0, 3)
COMMAND_ARM, COMMAND_GRIPPER = slice(3, 9), slice(9, 10)
COMMAND_ARM_JOINTS = slice(3, 10)  # both
COMMAND_LEGS = slice(10, 22)
COMMAND_FRONT_LEFT, COMMAND_FRONT_RIGHT = slice(10, 13), slice(13, 16)
COMMAND_PITCH_HEIGHT = slice(23, 25)
COMMAND_SIZE = 25
ACTION_SIZE = 12
OBSERVATION_SIZE = 84

KP = (60.0,) * 12 + (120.0,) * 6 + (16.0,)  # [Nm/rad]
KD = (1.5,) * 12 + (2.0,) * 6 + (0.32,)  # [Nm s/rad]
