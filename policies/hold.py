"""The controller without a policy: the command is the joint targets, which the servos hold.

For planning over the joints themselves (robots/joint_actions.py), and for rollouts of physics
alone, which show what a policy adds.
"""

from dataclasses import replace

import numpy as np

from sumo_dist.policies.contract import PolicyContract
from sumo_dist.policies.policy import Policy

NAME = "joint-targets"  # what a task calls this controller
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
    """Replace the policy of a contract: nc = nu joint targets [rad] instead of its command.

    What stays is the robot's: joints, gains and rate.
    """
    physics_only = replace(
        contract,
        name=NAME,
        command_size=len(contract.joints),
        observation_size=0,
        action_size=0,
        memory_size=0,
        weights_sha256="",
    )
    return HoldTargets(physics_only, KIND, ())
