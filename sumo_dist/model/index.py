"""Named access to a state, the row (nq + nv,) of qpos followed by qvel."""

from collections.abc import Sequence
from typing import Literal

import mujoco
import numpy as np

from sumo_dist.errors import UsageError, unknown


def label(model: mujoco.MjModel, kind: Literal["body", "joint", "geom"], i: int) -> str:
    """Name of an element of a model; of one without a name `<kind>_<number>`."""
    return getattr(model, kind)(i).name or f"{kind}_{i}"


class StateIndex:
    """Where the bodies and joints of a model lie in its states.

    Attributes:
        nq, nv: lengths of qpos and qvel.
        free_bodies: names of the bodies with a free joint, in qpos order; see `label`.
        columns: of each hinge and slide by name, where its position and velocity are in a state.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Read the layout of a compiled model."""
        self.nq: int = model.nq
        self.nv: int = model.nv
        self._free: dict[str, tuple[int, int]] = {}  # body -> where in qpos and qvel
        self.columns: dict[str, tuple[int, int]] = {}
        for i in range(model.njnt):
            in_qpos, in_qvel = model.jnt_qposadr[i], model.jnt_dofadr[i]
            if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE:
                self._free[label(model, "body", model.jnt_bodyid[i])] = in_qpos, in_qvel
            elif model.jnt_type[i] != mujoco.mjtJoint.mjJNT_BALL:
                self.columns[label(model, "joint", i)] = in_qpos, self.nq + in_qvel
        self.free_bodies = tuple(self._free)

    def pose(self, body: str) -> slice:
        """Slice of a free body's position, world [m], and quaternion wxyz, in qpos or a state."""
        start, _ = self._find(body)
        return slice(start, start + 7)

    def velocity(self, body: str) -> slice:
        """Slice of a state: linear velocity, world [m/s], and angular, body frame [rad/s]."""
        _, start = self._find(body)
        return slice(self.nq + start, self.nq + start + 6)

    def joints(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Indices of hinge or slide joints' positions and velocities in a state."""
        for name in names:
            if name not in self.columns:
                raise unknown("joint", name, self.columns)
        indices = np.array([self.columns[name] for name in names], np.intp).reshape(-1, 2)
        return indices[:, 0], indices[:, 1]

    def pack(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """(..., nq) and (..., nv) to states (..., nq + nv)."""
        return np.concatenate([qpos, qvel], axis=-1)

    def unpack(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States (..., nq + nv) to views of qpos (..., nq) and qvel (..., nv)."""
        if np.shape(state)[-1:] != (self.nq + self.nv,):
            raise UsageError(f"state of shape {np.shape(state)}; needs (..., {self.nq + self.nv})")
        return state[..., : self.nq], state[..., self.nq :]

    def _find(self, body: str) -> tuple[int, int]:
        if body not in self._free:
            raise unknown("free body", body, self._free)
        return self._free[body]
