from collections.abc import Sequence

import numpy as np

from sumo_dist.policies.network import Layer

SOURCE_HASH: str

def kernels() -> list[tuple[str, str]]: ...
def evaluate(
    layers: Sequence[Layer],
    inputs: np.ndarray,
    outputs: np.ndarray,
    kernel: str,
) -> None: ...
def spot_relic(layers: Sequence[Layer], layout: SpotLayout, portable: bool) -> Policy: ...
def g1_gait(layers: Sequence[Layer], layout: G1Layout, portable: bool) -> Policy: ...
def hold_targets(targets: int) -> Policy: ...

class SpotLayout:
    joints_to_network: Sequence[int]
    action_to_legs: Sequence[int]
    joint_offsets: Sequence[float]
    action_scale: float
    leg_size: int
    command_size: int
    command_arm: int
    command_legs: int

class G1Layout:
    joint_offsets: Sequence[float]
    action_scale: float
    spin_scale: float
    joint_speed_scale: float
    phases: Sequence[Sequence[float]]
    standing: float
    stand_below: float
    feedback_gain: Sequence[float]
    feedback_limit: float
    feedback_share: float
    first_arm: int
    arm_size: int
    command_size: int
    command_arms: int
    command_follows: int
    memory_size: int
    memory_gait: int
    memory_velocity: int

class Policy:
    def step(
        self,
        qpos: np.ndarray,
        qvel: np.ndarray,
        command: np.ndarray,
        memory: np.ndarray,
        targets: np.ndarray,
    ) -> None: ...

class Physics:
    def __init__(
        self,
        models: Sequence[int],
        step: int,
        set_state: int,
        get_state: int,
        kinematics: int,
        signature: int,
        state_size: int,
        nq: int,
        nv: int,
        nu: int,
        qpos: int,
        substeps: int,
    ) -> None: ...

class Simulation:
    def __init__(
        self,
        data: int,
        qpos: int,
        qvel: int,
        ctrl: int,
        frames: Sequence[tuple[int, int]],
        warnings: Sequence[int],
    ) -> None: ...

class Engine:
    def __init__(
        self, physics: Physics, policy: Policy, simulations: Sequence[Simulation], group: int
    ) -> None: ...
    def rollout(
        self,
        starts: np.ndarray,
        memories: np.ndarray,
        commands: np.ndarray,
        models: np.ndarray,
        states: np.ndarray,
        targets: np.ndarray,
        positions: np.ndarray,
        rotations: np.ndarray,
        memory_out: np.ndarray,
        valid: np.ndarray,
    ) -> None: ...
