"""Named access to a state, the row (nq + nv,) of qpos followed by qvel."""

from collections.abc import Sequence

import mujoco
import numpy as np

from sumo_dist.errors import UsageError, unknown


class StateIndex:
    """Where the bodies and joints of a model lie in its states.

    Attributes:
        nq, nv: lengths of qpos and qvel.
        free_bodies: names of the bodies with a free joint, in qpos order.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Read the layout of a compiled model."""
        self.nq: int = model.nq
        self.nv: int = model.nv
        self._addresses: dict[str, tuple[int, int]] = {}  # joint -> in qpos, in qvel
        self._free_joints: dict[str, str] = {}  # body -> joint
        for i in range(model.njnt):
            joint = model.joint(i)
            self._addresses[joint.name] = int(joint.qposadr[0]), int(joint.dofadr[0])
            if joint.type[0] == mujoco.mjtJoint.mjJNT_FREE:
                self._free_joints[model.body(joint.bodyid[0]).name] = joint.name
        self.free_bodies = tuple(self._free_joints)

    def pose(self, body: str) -> slice:
        """Slice of a free body's position, world [m], and quaternion wxyz, in qpos or a state."""
        start, _ = self._free(body)
        return slice(start, start + 7)

    def velocity(self, body: str) -> slice:
        """Slice of a state: linear velocity, world [m/s], and angular, body frame [rad/s]."""
        _, start = self._free(body)
        return slice(self.nq + start, self.nq + start + 6)

    def joints(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Indices of hinge or slide joints' positions and velocities in a state."""
        for name in names:
            if name not in self._addresses:
                raise unknown("joint", name, self._addresses)
        addresses = np.array([self._addresses[name] for name in names], np.intp).reshape(-1, 2)
        return addresses[:, 0], self.nq + addresses[:, 1]

    def pack(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """(..., nq) and (..., nv) to states (..., nq + nv)."""
        return np.concatenate([qpos, qvel], axis=-1)

    def unpack(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States (..., nq + nv) to views of qpos (..., nq) and qvel (..., nv)."""
        if np.shape(state)[-1:] != (self.nq + self.nv,):
            raise UsageError(f"state of shape {np.shape(state)}; needs (..., {self.nq + self.nv})")
        return state[..., : self.nq], state[..., self.nq :]

    def _free(self, body: str) -> tuple[int, int]:
        if body not in self._free_joints:
            raise unknown("free body", body, self._free_joints)
        return self._addresses[self._free_joints[body]]
