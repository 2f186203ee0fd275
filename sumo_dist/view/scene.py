"""A compiled model in Rerun: its geometry once, then the poses of its bodies."""

from collections.abc import Callable

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.model.index import label
from sumo_dist.view.outputs import Outputs

VISIBLE_GROUPS = 3  # geom groups 0, 1, 2 are drawn, as in MuJoCo's own viewer; 3 is collision
HFIELD_LINES = 100  # of a height field that are drawn in each direction, at most
GROUND = (66, 72, 83)
_NO_COLOR = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # MuJoCo's default: the material decides
_Geom = mujoco.mjtGeom


class SceneLog:
    """Logs a model's visible geometry, then its bodies' poses in columnar chunks.

    Every drawn body is a named frame below the world; its geoms rest in that frame.
    """

    def __init__(self, out: Outputs, model: mujoco.MjModel, chunk_ticks: int) -> None:
        """Log the geometry; poses go out every `chunk_ticks` ticks and on flush."""
        self._out = out
        self._chunk_ticks = chunk_ticks
        geoms = [int(geom) for geom in np.flatnonzero(_drawn(model))]
        self._bodies = sorted({int(model.geom_bodyid[geom]) for geom in geoms} - {0})
        self._names = [label(model, "body", body) for body in self._bodies]
        self._full_chunk_frames = self._child_frames(chunk_ticks)  # encoded once
        self._ticks: list[int] = []
        self._poses: list[np.ndarray] = []  # per tick, (bodies, 7)
        for geom in geoms:
            _log_geom(out, model, geom)

    def add(self, tick: int, data: mujoco.MjData) -> None:
        """Take the poses of one tick; the data's kinematics are current."""
        self._ticks.append(tick)
        self._poses.append(np.hstack([data.xpos[self._bodies], data.xquat[self._bodies]]))
        if len(self._ticks) == self._chunk_ticks:
            self.flush()

    def flush(self) -> None:
        """Send the poses at hand, one row for each tick and body."""
        if not self._ticks or not self._names:
            return
        count = len(self._ticks)
        poses = np.concatenate(self._poses).astype(np.float32)
        moved = rr.Transform3D.columns(translation=poses[:, :3], quaternion=_xyzw(poses[:, 3:]))
        full = count == self._chunk_ticks
        frames = self._full_chunk_frames if full else self._child_frames(count)
        self._out.send("world/poses", np.repeat(self._ticks, len(self._names)), [*moved, *frames])
        self._ticks, self._poses = [], []

    def _child_frames(self, ticks: int) -> rr.ComponentColumnList:
        return rr.Transform3D.columns(child_frame=self._names * ticks)


def _drawn(model: mujoco.MjModel) -> np.ndarray:
    """Mask (ngeom,) of the visible geoms; all are, of what would else not be seen."""
    visible = model.geom_group < VISIBLE_GROUPS
    things = model.body_rootid[model.geom_bodyid]
    return visible | ~np.isin(things, things[visible])


def _log_geom(out: Outputs, model: mujoco.MjModel, geom: int) -> None:
    kind = _Geom(model.geom_type[geom])
    if kind not in _SHAPES:
        return
    body, name = int(model.geom_bodyid[geom]), label(model, "geom", geom)
    shape, offset = _SHAPES[kind](model, geom)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    pose = rr.InstancePoses3D(
        translations=[model.geom_pos[geom] + rotation.reshape(3, 3) @ offset],
        quaternions=[_xyzw(model.geom_quat[geom])],
    )
    if body:
        frame = label(model, "body", body)
        out.log(["world", "bodies", frame, name], rr.CoordinateFrame(frame), pose, shape)
    else:
        out.log(["world", "fixed", name], pose, shape)


_Shape = tuple[rr.AsComponents, np.ndarray]
"""A Rerun shape, and where its origin lies in the geom's frame."""


def _ellipsoid(model: mujoco.MjModel, geom: int) -> _Shape:
    size = model.geom_size[geom]
    radii = size if model.geom_type[geom] == _Geom.mjGEOM_ELLIPSOID else np.repeat(size[0], 3)
    return rr.Ellipsoids3D(half_sizes=[radii], **_solid(model, geom)), np.zeros(3)


def _capsule(model: mujoco.MjModel, geom: int) -> _Shape:
    radius, half, _ = model.geom_size[geom]
    shape = rr.Capsules3D(lengths=[2 * half], radii=[radius], **_solid(model, geom))
    return shape, np.array([0.0, 0.0, -half])  # Rerun's capsules start at their origin


def _cylinder(model: mujoco.MjModel, geom: int) -> _Shape:
    radius, half, _ = model.geom_size[geom]
    shape = rr.Cylinders3D(lengths=[2 * half], radii=[radius], **_solid(model, geom))
    return shape, np.zeros(3)


def _box(model: mujoco.MjModel, geom: int) -> _Shape:
    shape = rr.Boxes3D(half_sizes=[model.geom_size[geom]], **_solid(model, geom))
    return shape, np.zeros(3)


def _plane(model: mujoco.MjModel, geom: int) -> _Shape:
    x, y = (half or 50.0 for half in model.geom_size[geom][:2])  # 0 is MuJoCo's infinite
    thin = 0.005
    slab = rr.Boxes3D(half_sizes=[[x, y, thin]], colors=[GROUND], fill_mode="solid")
    return slab, np.array([0.0, 0.0, -2 * thin])  # below the grid lines and what stands on it


def _hfield(model: mujoco.MjModel, geom: int) -> _Shape:
    field = model.geom_dataid[geom]
    nrow, ncol, first = model.hfield_nrow[field], model.hfield_ncol[field], model.hfield_adr[field]
    x, y, top, _ = model.hfield_size[field]
    rows, columns = _thinned(nrow), _thinned(ncol)
    heights = model.hfield_data[first : first + nrow * ncol].reshape(nrow, ncol)
    across, along = np.meshgrid(x * (2 * columns / (ncol - 1) - 1), y * (2 * rows / (nrow - 1) - 1))
    points = np.stack([across, along, top * heights[np.ix_(rows, columns)]], axis=-1)
    corner = np.arange(points[..., 0].size).reshape(points.shape[:2])
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    slope_y, slope_x = np.gradient(points[..., 2], along[:, 0], across[0])
    shape = rr.Mesh3D(
        vertex_positions=points.reshape(-1, 3),
        vertex_normals=np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], -1).reshape(-1, 3),
        triangle_indices=np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3),
        albedo_factor=_color(model, geom),
    )
    return shape, np.zeros(3)


def _thinned(lines: int) -> np.ndarray:
    """Which of a height field's rows or columns are drawn."""
    return np.unique(np.linspace(0, lines - 1, min(lines, HFIELD_LINES)).round().astype(int))


def _mesh(model: mujoco.MjModel, geom: int) -> _Shape:
    mesh = model.geom_dataid[geom]
    first = model.mesh_faceadr[mesh]
    faces = slice(first, first + model.mesh_facenum[mesh])
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[faces]]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[faces]]
    shape = rr.Mesh3D(  # a vertex has one normal per face in MuJoCo: no vertex is shared
        vertex_positions=vertices.reshape(-1, 3),
        vertex_normals=normals.reshape(-1, 3),
        triangle_indices=np.arange(3 * len(vertices)).reshape(-1, 3),
        albedo_factor=_color(model, geom),
    )
    return shape, np.zeros(3)


_SHAPES: dict[mujoco.mjtGeom, Callable[[mujoco.MjModel, int], _Shape]] = {
    _Geom.mjGEOM_PLANE: _plane,
    _Geom.mjGEOM_SPHERE: _ellipsoid,
    _Geom.mjGEOM_ELLIPSOID: _ellipsoid,
    _Geom.mjGEOM_CAPSULE: _capsule,
    _Geom.mjGEOM_CYLINDER: _cylinder,
    _Geom.mjGEOM_BOX: _box,
    _Geom.mjGEOM_MESH: _mesh,
    _Geom.mjGEOM_SDF: _mesh,  # the mesh that MuJoCo makes of it
    _Geom.mjGEOM_HFIELD: _hfield,
}


def _solid(model: mujoco.MjModel, geom: int) -> dict:
    return {"colors": [_color(model, geom)], "fill_mode": rr.components.FillMode.Solid}


def _color(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return a geom's RGBA (4,) uint8, by MuJoCo's rule: its own colour, else the material's."""
    rgba, material = model.geom_rgba[geom], model.geom_matid[geom]
    if material >= 0 and np.array_equal(rgba, _NO_COLOR):
        rgba = model.mat_rgba[material]
    return (rgba * 255).round().astype(np.uint8)


def _xyzw(quat_wxyz: np.ndarray) -> np.ndarray:
    return quat_wxyz[..., [1, 2, 3, 0]]
