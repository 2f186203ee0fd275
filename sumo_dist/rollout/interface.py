"""What every rollout engine offers: s' = f(s, policy(s, c)) for many rows at once."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from sumo_dist.model.frames import FrameRef


@dataclass(frozen=True)
class Rollouts:
    """B rollouts of T policy steps. Row k is the state AFTER step k, with frames of that instant.

    Attributes:
        states: (B, T, nq + nv) qpos then qvel.
        targets: (B, T, nu) joint targets that the servos held during the step [rad].
        positions: (B, T, F, 3) frame origins, world [m].
        rotations: (B, T, F, 3, 3) frame axes as columns, world.
        memory: (B, nm) policy memory after the last step, float32.
        valid: (B,) False where a rollout diverged or became non-finite.
    """

    states: np.ndarray
    targets: np.ndarray
    positions: np.ndarray
    rotations: np.ndarray
    memory: np.ndarray
    valid: np.ndarray


class Controller(Protocol):
    """The low-level policy as a function; the robot runs this, the engine runs its twin."""

    def initial_memory(self) -> np.ndarray:
        """Return the memory of a policy that was just started, (nm,) float32."""
        ...

    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(nq,), (nv,), (nc,), (nm,) -> joint targets (nu,) [rad] and the next memory (nm,)."""
        ...


class Engine(Protocol):
    """Policy-in-the-loop rollouts on one model. Not thread-safe; close it when done, or use with.

    A row's result depends on its start, memory, commands and model alone, not on its neighbours. A
    row that diverges or becomes non-finite is marked, and NaN from that step on.
    """

    name: str  # "native-avx2" | "native-portable" | "fallback"
    build: str  # identifies code, kernel and MuJoCo version; equal builds give equal bits
    frames: tuple[FrameRef, ...]

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def rollout(
        self,
        state: np.ndarray,
        memory: np.ndarray,
        commands: np.ndarray,
        models: np.ndarray | None = None,
    ) -> Rollouts:
        """Roll out B command sequences.

        Args:
            state: (nq + nv,) float64 from which all rows start, or (B, nq + nv).
            memory: (nm,) float32 policy memory before the first step, or (B, nm).
            commands: (B, T, nc) float64.
            models: (B,) integers, which model a row runs on: 0 the engine's own, i the i-th of
                the variations that the engine was made with. None is 0 for all.
        """
        ...

    def close(self) -> None:
        """Stop the engine's threads and free its simulations."""
        ...
