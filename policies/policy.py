"""What a loaded policy is: its contract, its network and its twin in numpy."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from sumo_dist.policies.contract import PolicyContract

Layer = tuple[np.ndarray, np.ndarray]  # W (outputs, inputs) and b (outputs,), float32

# The network sees this many rows at once, padded: BLAS rounds differently for other batch sizes,
# and a row's result must not depend on its neighbours.
BLOCK = 16


@dataclass(frozen=True, eq=False)  # weights have no cheap equality
class Policy(ABC):
    """A pretrained low-level policy: state, command and memory in, joint targets out.

    Attributes:
        contract: what the policy expects of the robot and of its caller.
        kind: which observation and action code belongs to the network.
        activation: between the layers, "elu"; the output is linear.
        layers: of the network, first to last.
    """

    contract: PolicyContract
    kind: str
    activation: str
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


def elu_network(layers: tuple[Layer, ...], rows: np.ndarray) -> np.ndarray:
    """Evaluate an ELU network with linear output.

    Args:
        layers: of the network.
        rows: (..., inputs) float32.

    Returns:
        (..., outputs) float32.
    """
    flat = rows.reshape(-1, rows.shape[-1])  # (B, inputs)
    outputs = np.empty((len(flat), len(layers[-1][1])), np.float32)
    for start in range(0, len(flat), BLOCK):
        block = flat[start : start + BLOCK]
        values = np.zeros((BLOCK, flat.shape[1]), np.float32)
        values[: len(block)] = block
        for weight, bias in layers[:-1]:
            values = values @ weight.T + bias
            values = np.where(values > 0.0, values, np.expm1(np.minimum(values, 0.0)))
        weight, bias = layers[-1]
        outputs[start : start + BLOCK] = (values @ weight.T + bias)[: len(block)]
    return outputs.reshape(*rows.shape[:-1], -1)
