"""G1's velocity policies (holosoma): all joints from the network, arms as commanded.

The policy walks to a clock: two phases, half a period apart, that run while it moves and rest
while it stands. Two things are ours, as it was trained for neither. While an arm follows the
command, the network sees it at its default pose, at rest: told the truth, it falls. And it does not
observe how fast the robot moves, so it stalls against a load: the command it is given is corrected
by how far the velocity lags behind. `g1_layout` states the numbers.
"""

import json
from pathlib import Path

import numpy as np

from sumo_dist.errors import SumoError
from sumo_dist.math import rotations
from sumo_dist.policies.contract import PolicyContract
from sumo_dist.policies.g1_layout import (
    ACTION_SCALE,
    ACTION_SIZE,
    ARM_SIZE,
    ARMS,
    COMMAND_ARMS,
    COMMAND_BASE,
    COMMAND_FOLLOWS,
    COMMAND_SIZE,
    FEEDBACK_GAIN,
    FEEDBACK_LIMIT,
    FEEDBACK_SHARE,
    GAIT_TICKS,
    JOINT_OFFSETS,
    JOINT_SPEED_SCALE,
    JOINTS,
    KIND,
    MEMORY_GAIT,
    MEMORY_SIZE,
    MEMORY_VELOCITY,
    OBSERVATION_SIZE,
    PHASES,
    SPIN_SCALE,
    STAND_BELOW,
    STANDING,
)
from sumo_dist.policies.manifest import PinnedPolicy
from sumo_dist.policies.network import evaluate
from sumo_dist.policies.onnx_mlp import read_metadata, read_mlp
from sumo_dist.policies.policy import Policy

_OFFSETS = np.array(JOINT_OFFSETS)
_GAIN = np.array(FEEDBACK_GAIN)


def advance(
    qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute what changes before the network is evaluated.

    Returns:
        gait: (...,) float32, this evaluation's tick of the gait, STANDING if it stands.
        velocity: (..., 3) float32, the filtered velocity of the base, in its frame.
        wish: (..., 3) float64, the corrected velocity command.
    """
    before = memory[..., MEMORY_VELOCITY].astype(np.float64)
    velocity = before + FEEDBACK_SHARE * (_base_velocity(qpos, qvel) - before)
    velocity = velocity.astype(np.float32)
    wanted = command[..., COMMAND_BASE]
    norm2 = wanted[..., 0] ** 2 + wanted[..., 1] ** 2 + wanted[..., 2] ** 2
    stands = norm2 < STAND_BELOW**2
    begins = np.where(memory[..., MEMORY_GAIT] == STANDING, 0.0, memory[..., MEMORY_GAIT])
    gait = np.where(stands, STANDING, begins).astype(np.float32)
    corrected = np.clip(wanted + _GAIN * (wanted - velocity), -FEEDBACK_LIMIT, FEEDBACK_LIMIT)
    return gait, velocity, np.where(stands[..., None], 0.0, corrected)


def observation(
    qpos: np.ndarray,
    qvel: np.ndarray,
    command: np.ndarray,
    last_action: np.ndarray,
    gait: np.ndarray,
    wish: np.ndarray,
) -> np.ndarray:
    """Compute what the network sees, in float64, rounded once at the end.

    Args:
        qpos: (..., nq) base position, base quaternion wxyz, 29 joints, then anything.
        qvel: (..., nv) base velocity (world), base rotation (body), 29 joints, then anything.
        command: (..., 19).
        last_action: (..., 29).
        gait, wish: see `advance`.

    Returns:
        (..., 100) float32: the last action 29; base rotation 3; commanded wz, vx, vy; cosines of
        the phases 2; joint positions 29 and velocities 29; gravity direction 3, base frame; sines
        of the phases 2.
    """
    seen = 1.0 - _arms(command)  # (..., 29)
    up = rotations.matrix(qpos[..., 3:7])[..., 2, :]
    phases = PHASES[np.where(np.isfinite(gait), gait, STANDING).astype(np.intp)]
    parts = (
        *(last_action * seen, SPIN_SCALE * qvel[..., 3:6]),
        *(wish[..., 2:3], wish[..., :2], phases[..., :2]),
        *(seen * (qpos[..., 7:36] - _OFFSETS), seen * (JOINT_SPEED_SCALE * qvel[..., 6:35])),
        *(-up, phases[..., 2:]),
    )
    return np.concatenate(parts, axis=-1).astype(np.float32)


def joint_targets(action: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Turn the network's action (..., 29) and the command into joint targets (..., 29) [rad]."""
    targets = _OFFSETS + ACTION_SCALE * action.astype(np.float64)
    commanded = np.zeros(targets.shape)
    commanded[..., ARMS] = command[..., COMMAND_ARMS]
    return np.where(_arms(command) > 0.5, commanded, targets)


class G1Policy(Policy):
    """A holosoma policy; see the module for its memory."""

    def initial_memory(self) -> np.ndarray:
        """Return the memory of a robot that stands, (33,) float32."""
        memory = np.zeros(MEMORY_SIZE, np.float32)
        memory[MEMORY_GAIT] = STANDING
        return memory

    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the policy once: targets (..., 29) and memory (..., 33); see `Policy.step`.

        Raises:
            SumoError: an array has a wrong last dimension.
        """
        _check_shapes(qpos, qvel, command, memory)
        with np.errstate(over="ignore", invalid="ignore"):  # rows of diverged rollouts
            gait, velocity, wish = advance(qpos, qvel, command, memory)
            last_action = memory[..., :ACTION_SIZE]
            action = evaluate(
                self.layers, observation(qpos, qvel, command, last_action, gait, wish)
            )
            following = np.where(gait == STANDING, STANDING, (gait + 1.0) % GAIT_TICKS)
        parts = (action, following[..., None].astype(np.float32), velocity)
        return joint_targets(action, command), np.concatenate(parts, axis=-1)


def load(pinned: PinnedPolicy, weights: Path) -> G1Policy:
    """Read a policy from its weights file; joints and gains come from the file's metadata.

    Raises:
        SumoError: the file does not hold a network of 100 inputs and 29 outputs, or lacks them.
    """
    metadata = read_metadata(weights)
    try:
        joints, kp, kd = (tuple(json.loads(metadata[key])) for key in ("dof_names", "kp", "kd"))
    except (KeyError, ValueError, TypeError):
        raise SumoError(f"{weights}: its metadata lacks dof_names, kp or kd") from None
    contract = PolicyContract(
        name=pinned.name,
        rate_hz=50.0,
        joints=joints,
        kp=kp,
        kd=kd,
        command_size=COMMAND_SIZE,
        observation_size=OBSERVATION_SIZE,
        action_size=ACTION_SIZE,
        memory_size=MEMORY_SIZE,
        weights_sha256=pinned.sha256,
    )
    return G1Policy(contract, KIND, read_mlp(weights, OBSERVATION_SIZE, ACTION_SIZE))


def _base_velocity(qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Velocity vx, vy [m/s] and wz [rad/s] of the base in its own frame, (..., 3)."""
    rotation = rotations.matrix(qpos[..., 3:7])
    velocity = (rotation * qvel[..., :3, None]).sum(-2)
    return np.concatenate((velocity[..., :2], qvel[..., 5:6]), axis=-1)


def _arms(command: np.ndarray) -> np.ndarray:
    """Return (..., 29): 1 for the joints of an arm that follows the command, else 0."""
    follows = np.zeros((*command.shape[:-1], len(JOINTS)))
    follows[..., ARMS] = np.repeat(command[..., COMMAND_FOLLOWS] > 0.5, ARM_SIZE, axis=-1)
    return follows


def _check_shapes(
    qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
) -> None:
    enough = qpos.shape[-1] >= 7 + len(JOINTS) and qvel.shape[-1] >= 6 + len(JOINTS)
    if not enough or command.shape[-1] != COMMAND_SIZE or memory.shape[-1] != MEMORY_SIZE:
        raise SumoError(
            f"g1 policy: qpos {qpos.shape}, qvel {qvel.shape}, command {command.shape}, "
            f"memory {memory.shape}; valid: qpos (..., 36 or more), qvel (..., 35 or more), "
            f"command (..., {COMMAND_SIZE}), memory (..., {MEMORY_SIZE})"
        )
