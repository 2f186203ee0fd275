"""The layout of G1's velocity policies: joint names, offsets, parts of command and memory, gait.

Stated here once: the policies, the robot, its action space and the native engine take it from here.
"""

import numpy as np

from sumo_dist.timing import TICK

KIND = "g1_gait"
SIDES = ("left", "right")
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
WAIST = ("waist_yaw", "waist_roll", "waist_pitch")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")
JOINTS = (  # of model and network
    *(f"{side}_{joint}_joint" for side in SIDES for joint in LEG),
    *(f"{joint}_joint" for joint in WAIST),
    *(f"{side}_{joint}_joint" for side in SIDES for joint in (*ARM, *WRIST)),
)
ARM_SIZE = 7  # with the wrist
ARMS = slice(15, 29)  # among the joints, the last

# What the network's joint positions and actions are relative to: knees bent, arms beside the body
# [rad].
LEG_OFFSETS = (-0.312, 0.0, 0.0, 0.669, -0.363, 0.0)
LEFT_ARM_OFFSETS = (0.2, 0.2, 0.0, 0.6, 0.0, 0.0, 0.0)
RIGHT_ARM_OFFSETS = (0.2, -0.2, 0.0, 0.6, 0.0, 0.0, 0.0)
JOINT_OFFSETS = (*LEG_OFFSETS, *LEG_OFFSETS, 0.0, 0.0, 0.0, *LEFT_ARM_OFFSETS, *RIGHT_ARM_OFFSETS)
ACTION_SCALE = 0.25  # [rad] per unit of action
SPIN_SCALE = 0.25  # of the base's angular velocity in the observation
JOINT_SPEED_SCALE = 0.05

# The command: base velocity vx, vy [m/s], wz [rad/s]; targets of the arms, left and right [rad];
# for each arm whether it follows them (above 0.5) or the policy.
COMMAND_BASE = slice(0, 3)
COMMAND_ARMS = slice(3, 17)
COMMAND_FOLLOWS = slice(17, 19)
COMMAND_SIZE = 19
ACTION_SIZE = len(JOINTS)
OBSERVATION_SIZE = 100

# The memory: the last action; ticks since the gait began, -1 while the robot stands; the base's
# velocity vx, vy [m/s], wz [rad/s] through a low-pass filter.
MEMORY_GAIT = 29
MEMORY_VELOCITY = slice(30, 33)
MEMORY_SIZE = 33
STANDING = -1.0

GAIT_TICKS = 50  # policy steps a period
STAND_BELOW = 0.05  # norm of the commanded velocity [m/s, rad/s] that means: stand

# Velocity feedback: the network gets clip(c + GAIN (c - v), -LIMIT, LIMIT) in place of c. Greater
# gains push more and fall sooner.
FEEDBACK_GAIN = (1.0, 1.0, 0.3)
FEEDBACK_LIMIT = 1.5  # [m/s, rad/s]
FEEDBACK_TIME = 0.5  # of the velocity's filter [s]
FEEDBACK_SHARE = TICK / FEEDBACK_TIME

_ANGLES = 2.0 * np.pi * np.arange(GAIT_TICKS) / GAIT_TICKS
# (GAIT_TICKS + 1, 4) float32: cosines and sines of both phases; the last row is of standing.
PHASES = np.concatenate(
    (
        np.stack((np.cos(_ANGLES), -np.cos(_ANGLES), np.sin(_ANGLES), -np.sin(_ANGLES)), axis=1),
        [[-1.0, -1.0, 0.0, 0.0]],
    )
).astype(np.float32)
