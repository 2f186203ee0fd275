"""Spot's whole-body policy (Relic): legs from the network, arm and gripper as commanded.

The policy sees the state and a 25-d command and outputs targets of the 12 leg joints; a leg whose
command is not all zero takes its targets from the command instead. Its network orders the joints
by kind, the model by limb; `spot_layout` states both.
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
from sumo_dist.policies.spot_layout import (
    ACTION_SCALE,
    ACTION_SIZE,
    ACTION_TO_LEGS,
    COMMAND_ARM_JOINTS,
    COMMAND_LEGS,
    COMMAND_SIZE,
    JOINT_OFFSETS,
    JOINTS,
    JOINTS_TO_NETWORK,
    KD,
    KIND,
    KP,
    LEG_OFFSETS,
    LEG_SIZE,
    LEGS,
    OBSERVATION_SIZE,
)

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
    overridden = commanded.reshape(*command.shape[:-1], len(LEGS), LEG_SIZE).any(-1)  # (..., 4)
    legs = np.where(np.repeat(overridden, LEG_SIZE, axis=-1), commanded, legs)
    return np.concatenate((legs, command[..., COMMAND_ARM_JOINTS]), axis=-1)


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
