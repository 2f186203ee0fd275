from collections.abc import Sequence

import numpy as np

SOURCE_HASH: str

def best_kernel() -> str: ...
def evaluate(
    layers: Sequence[tuple[np.ndarray, np.ndarray]],
    inputs: np.ndarray,
    outputs: np.ndarray,
    portable: bool,
) -> None: ...
def spot_relic(
    layers: Sequence[tuple[np.ndarray, np.ndarray]],
    joints_to_network: Sequence[int],
    action_to_legs: Sequence[int],
    joint_offsets: Sequence[float],
    action_scale: float,
    portable: bool,
) -> Policy: ...
def hold_targets(targets: int) -> Policy: ...

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
        model: int,
        step: int,
        set_state: int,
        kinematics: int,
        signature: int,
        nq: int,
        nv: int,
        nu: int,
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
        self, physics: Physics, policy: Policy, simulations: Sequence[Simulation], threads: int
    ) -> None: ...
    def rollout(
        self,
        start: np.ndarray,
        memory: np.ndarray,
        commands: np.ndarray,
        states: np.ndarray,
        positions: np.ndarray,
        rotations: np.ndarray,
        memory_out: np.ndarray,
        valid: np.ndarray,
    ) -> None: ...
