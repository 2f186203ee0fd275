"""Spot's whole-body policy (Relic): legs from the network, arm and gripper as commanded.

The policy sees the state and a 25-d command and outputs targets of the 12 leg joints; a leg whose
command is not all zero takes its targets from the command instead. Its network orders the joints
by kind, the model by limb. The constants here are the only statement of that layout: the native
engine is given them.
"""

from pathlib import Path

import numpy as np

from sumo_dist.errors import SumoError
from sumo_dist.math import rotations
from sumo_dist.policies.contract import PolicyContract
from sumo_dist.policies.manifest import PinnedPolicy
from sumo_dist.policies.network import evaluate
from sumo_dist.policies.onnx_mlp import read_mlp
from sumo_dist.policies.policy import Policy

KIND = "spot_relic"
LEGS = ("fl", "fr", "hl", "hr")
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

# The command: base velocity vx, vy [m/s], wz [rad/s]; arm and gripper [rad]; legs [rad];
# torso roll, pitch [rad], height [m]. Joints in the model's order.
COMMAND_ARM = slice(3, 10)
COMMAND_LEGS = slice(10, 22)
COMMAND_SIZE = 25
ACTION_SIZE = 12
OBSERVATION_SIZE = 84

KP = (60.0,) * 12 + (120.0,) * 6 + (16.0,)  # [Nm/rad]
KD = (1.5,) * 12 + (2.0,) * 6 + (0.32,)  # [Nm s/rad]

_TO_NETWORK = np.array(JOINTS_TO_NETWORK)
_TO_LEGS = np.array(ACTION_TO_LEGS)
_JOINT_OFFSETS = np.array(JOINT_OFFSETS)
_LEG_OFFSETS = np.array(LEG_OFFSETS)


def observation(
    qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
) -> np.ndarray:
    """Compute what the network sees, in float64, rounded once at the end.

    Args:
        qpos: (..., nq) base position, base quaternion wxyz, 19 joints, then anything.
        qvel: (..., nv) base velocity (world), base rotation (body), 19 joints, then anything.
        command: (..., 25).
        memory: (..., 12) last action.

    Returns:
        (..., 84) float32: base velocity 3, base rotation 3 and gravity direction 3, all in the
        base frame; the command 25; joint positions 19 and velocities 19; the last action 12.
    """
    rotation = rotations.matrix(qpos[..., 3:7])  # (..., 3, 3) base to world
    velocity = (rotation * qvel[..., :3, None]).sum(-2)  # (..., 3) base frame
    joints = qpos[..., 7 + _TO_NETWORK] - _JOINT_OFFSETS[_TO_NETWORK]
    parts = (
        *(velocity, qvel[..., 3:6], -rotation[..., 2, :]),
        *(command, joints, qvel[..., 6 + _TO_NETWORK], memory),
    )
    return np.concatenate(parts, axis=-1).astype(np.float32)


def joint_targets(action: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Turn the network's action into joint targets.

    Every leg whose three command values are not all zero follows them literally.

    Args:
        action: (..., 12) in the network's order.
        command: (..., 25).

    Returns:
        (..., 19) float64 in the model's order [rad].
    """
    legs = _LEG_OFFSETS + ACTION_SCALE * action[..., _TO_LEGS].astype(np.float64)
    commanded = command[..., COMMAND_LEGS]
    overridden = commanded.reshape(*command.shape[:-1], len(LEGS), 3).any(-1)  # (..., 4)
    legs = np.where(np.repeat(overridden, 3, axis=-1), commanded, legs)
    return np.concatenate((legs, command[..., COMMAND_ARM]), axis=-1)


class SpotPolicy(Policy):
    """The Relic policy. Its memory is its last action, before scale, offset and overrides."""

    def initial_memory(self) -> np.ndarray:
        """Return zeros, (12,) float32."""
        return np.zeros(ACTION_SIZE, np.float32)

    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the policy once: targets (..., 19) and memory (..., 12); see `Policy.step`.

        Raises:
            SumoError: an array has a wrong last dimension.
        """
        _check_shapes(qpos, qvel, command, memory)
        with np.errstate(over="ignore", invalid="ignore"):  # rows of diverged rollouts
            seen = observation(qpos, qvel, command, memory)
            action = evaluate(self.layers, seen)
        return joint_targets(action, command), action


def load(pinned: PinnedPolicy, weights: Path) -> SpotPolicy:
    """Read the policy from its weights file.

    Raises:
        SumoError: the file does not hold an 84-to-12 ELU network.
    """
    contract = PolicyContract(
        name=pinned.name,
        rate_hz=50.0,
        joints=JOINTS,
        kp=KP,
        kd=KD,
        command_size=COMMAND_SIZE,
        observation_size=OBSERVATION_SIZE,
        action_size=ACTION_SIZE,
        memory_size=ACTION_SIZE,
        weights_sha256=pinned.sha256,
    )
    return SpotPolicy(contract, KIND, read_mlp(weights, OBSERVATION_SIZE, ACTION_SIZE))


def _check_shapes(
    qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
) -> None:
    enough = qpos.shape[-1] >= 7 + len(JOINTS) and qvel.shape[-1] >= 6 + len(JOINTS)
    if not enough or command.shape[-1] != COMMAND_SIZE or memory.shape[-1] != ACTION_SIZE:
        raise SumoError(
            f"spot policy: qpos {qpos.shape}, qvel {qvel.shape}, command {command.shape}, "
            f"memory {memory.shape}; valid: qpos (..., 26 or more), qvel (..., 25 or more), "
            f"command (..., {COMMAND_SIZE}), memory (..., {ACTION_SIZE})"
        )
