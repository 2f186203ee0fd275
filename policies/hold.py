"""No policy at all: rollouts of physics alone, to measure what the policy adds."""

from dataclasses import replace

import numpy as np

from sumo_dist.policies.contract import PolicyContract
from sumo_dist.policies.policy import Policy

KIND = "hold_targets"


class HoldTargets(Policy):
    """The command is the joint targets; there is no network and no memory."""

    def initial_memory(self) -> np.ndarray:
        """Return an empty array."""
        return np.zeros(0, np.float32)

    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the command (..., nu) [rad] and the empty memory."""
        del qpos, qvel
        return np.array(command, np.float64), memory


def hold_targets(contract: PolicyContract) -> HoldTargets:
    """Replace the policy of a contract: nc = nu joint targets [rad] instead of its command."""
    physics_only = replace(
        contract,
        name=KIND,
        command_size=len(contract.joints),
        observation_size=0,
        action_size=0,
        memory_size=0,
        weights_sha256="",
    )
    return HoldTargets(physics_only, KIND, ())
