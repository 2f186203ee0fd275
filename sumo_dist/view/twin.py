"""A translucent twin of all that moves, in a colour of its own."""

from typing import Any

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.view.marks import Color
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.shapes import VISIBLE_GROUPS

_Geom = mujoco.mjtGeom
_FILL = rr.components.FillMode.TransparentFillMajorWireframe


class TwinLog:
    """Draws what moves in a state, translucent."""

    def __init__(self, out: Outputs, model: mujoco.MjModel, path: str, color: Color) -> None:
        """Sort the geoms of a plant's model by shape; the path is that of their entities."""
        self._out, self._model, self._path, self._color = out, model, path, color
        self._data = mujoco.MjData(model)
        moving = model.body_weldid[model.geom_bodyid] != 0
        seen = np.flatnonzero(moving & (model.geom_group < VISIBLE_GROUPS))
        self._geoms = {
            name: seen[np.isin(model.geom_type[seen], kinds)] for name, kinds in _KINDS.items()
        }

    def show(self, tick: int, state: np.ndarray) -> None:
        """Draw a state (nq + nv,) at a tick."""
        self._data.qpos[:] = state[: self._model.nq]
        mujoco.mj_kinematics(self._model, self._data)
        for name, geoms in self._geoms.items():
            if len(geoms):
                self._out.log(f"{self._path}/{name}", self._shapes(name, geoms), tick=tick)

    def _shapes(self, name: str, geoms: np.ndarray) -> rr.AsComponents:
        """Geoms of one shape where the simulation has them now."""
        size, centre = self._model.geom_size[geoms], self._data.geom_xpos[geoms]
        turn = self._data.geom_xmat[geoms].reshape(-1, 3, 3)
        look: dict[str, Any] = {"colors": [(*self._color, 110)], "fill_mode": _FILL}
        look["quaternions"] = [_xyzw(matrix) for matrix in turn]
        if name == "capsules":
            start = centre - turn[:, :, 2] * size[:, 1:2]  # Rerun's capsules start at their origin
            return rr.Capsules3D(
                lengths=2 * size[:, 1], radii=size[:, 0], translations=start, **look
            )
        if name == "cylinders":
            return rr.Cylinders3D(lengths=2 * size[:, 1], radii=size[:, 0], centers=centre, **look)
        if name == "ellipsoids":
            round_ = self._model.geom_type[geoms, None] == _Geom.mjGEOM_SPHERE
            return rr.Ellipsoids3D(
                half_sizes=np.where(round_, size[:, :1], size), centers=centre, **look
            )
        bounds = self._model.geom_aabb[geoms]  # of a mesh, the box around it
        centre = centre + np.einsum("nij,nj->ni", turn, bounds[:, :3])
        return rr.Boxes3D(half_sizes=bounds[:, 3:], centers=centre, **look)


_KINDS = {
    "capsules": [_Geom.mjGEOM_CAPSULE],
    "cylinders": [_Geom.mjGEOM_CYLINDER],
    "ellipsoids": [_Geom.mjGEOM_SPHERE, _Geom.mjGEOM_ELLIPSOID],
    "boxes": [_Geom.mjGEOM_BOX, _Geom.mjGEOM_MESH],
}


def _xyzw(rotation: np.ndarray) -> np.ndarray:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, rotation.ravel())
    return quat[[1, 2, 3, 0]]
