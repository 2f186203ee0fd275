"""What a policy was trained with, which the robot it drives must have; see robots.compatibility."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PolicyContract:
    """What a policy expects; the robot must agree in every point.

    Attributes:
        name: the policy's.
        rate_hz: evaluations per second of robot time [Hz].
        joints: in the order of the model's qpos, actuators and the policy's targets.
        kp: stiffness of each joint's position servo [Nm/rad].
        kd: damping of each joint's position servo [Nm s/rad].
        command_size: nc.
        observation_size: inputs of the network.
        action_size: outputs of the network.
        memory_size: nm, floats carried from one evaluation to the next.
        weights_sha256: hash of the weights file.
    """

    name: str
    rate_hz: float
    joints: tuple[str, ...]
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    command_size: int
    observation_size: int
    action_size: int
    memory_size: int
    weights_sha256: str
