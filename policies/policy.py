"""What a loaded policy is: its contract, its network and its twin in numpy."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from sumo_dist.policies.contract import PolicyContract
from sumo_dist.policies.network import Layer


@dataclass(frozen=True, eq=False)  # weights have no cheap equality
class Policy(ABC):
    """A pretrained low-level policy: state, command and memory in, joint targets out.

    Attributes:
        contract: what the policy expects of the robot and of its caller.
        kind: which observation and action code belongs to the network.
        layers: of the network, first to last.
    """

    contract: PolicyContract
    kind: str
    layers: tuple[Layer, ...]

    @abstractmethod
    def initial_memory(self) -> np.ndarray:
        """Return the memory of a policy that was just started, (nm,) float32."""

    @abstractmethod
    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the policy once; a row's result does not depend on the other rows.

        Args:
            qpos: (..., nq) the robot's positions first, objects may follow [m, rad, wxyz].
            qvel: (..., nv) velocities as MuJoCo keeps them [m/s, rad/s].
            command: (..., nc).
            memory: (..., nm) float32, from the last step or `initial_memory`.

        Returns:
            Joint targets (..., nu) float64 [rad] in actuator order, and the next memory.
        """
