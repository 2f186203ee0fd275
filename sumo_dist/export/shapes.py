"""The visible geometry of a model as entities of Foxglove's scenes, one for each body."""

from typing import Any

import mujoco
import numpy as np

from sumo_dist.model.index import label
from sumo_dist.model.visible import drawn, height_field, rgba

WORLD = "world"  # name of the frame that all others are in
_FIELD_LINES = 60  # of a height field in each direction, at most
_Geom = mujoco.mjtGeom
_STILL = {"sec": 0, "nsec": 0}

Entity = dict[str, Any]


def entities(model: mujoco.MjModel) -> list[Entity]:
    """Return a model's visible geoms as foxglove.SceneEntity, each in its body's frame."""
    found, visible = list[Entity](), drawn(model)
    for body in range(model.nbody):
        geoms = np.flatnonzero((model.geom_bodyid == body) & visible)
        primitives: dict[str, list[Any]] = {k: [] for k in _KINDS}
        for geom in geoms:
            for kind, primitive in _primitives(model, int(geom)):
                primitives[kind].append(primitive)
        if any(primitives.values()):
            found.append(entity(frame(model, body), frame(model, body), primitives))
    return found


def entity(name: str, frame_id: str, primitives: dict[str, list[Any]]) -> Entity:
    """Return an entity that stays in a frame and is never taken away."""
    kinds = {kind: primitives.get(kind, []) for kind in _KINDS}
    about = {"timestamp": _STILL, "frame_id": frame_id, "id": name, "lifetime": _STILL}
    return {**about, "frame_locked": True, "metadata": [], **kinds}


_KINDS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def frame(model: mujoco.MjModel, body: int) -> str:
    """Name of a body's frame."""
    return label(model, "body", body) if body else WORLD


def vector(numbers: np.ndarray) -> dict[str, float]:
    """Return (3,) as foxglove.Vector3."""
    return dict(zip("xyz", np.round(np.asarray(numbers, float), 6).tolist(), strict=True))


def quaternion(wxyz: np.ndarray) -> dict[str, float]:
    """Return (4,) as foxglove.Quaternion."""
    return dict(zip("wxyz", np.round(np.asarray(wxyz, float), 7).tolist(), strict=True))


def pose(position: np.ndarray, wxyz: np.ndarray) -> dict[str, Any]:
    """Return a foxglove.Pose."""
    return {"position": vector(position), "orientation": quaternion(wxyz)}


def color(numbers: np.ndarray) -> dict[str, float]:
    """Return RGBA (4,) in [0, 1] as foxglove.Color."""
    return dict(zip("rgba", np.round(np.asarray(numbers, float), 4).tolist(), strict=True))


def _primitives(model: mujoco.MjModel, geom: int) -> list[tuple[str, dict[str, Any]]]:
    kind, size = _Geom(model.geom_type[geom]), model.geom_size[geom]
    position, turn = model.geom_pos[geom], model.geom_quat[geom]
    look = {"color": color(rgba(model, geom))}
    at = {"pose": pose(position, turn), **look}
    round_ = {"bottom_scale": 1.0, "top_scale": 1.0}
    tube = np.array([2 * size[0], 2 * size[0], 2 * size[1]])
    match kind:
        case _Geom.mjGEOM_BOX:
            return [("cubes", {**at, "size": vector(2 * size)})]
        case _Geom.mjGEOM_SPHERE:
            return [("spheres", {**at, "size": vector(np.full(3, 2 * size[0]))})]
        case _Geom.mjGEOM_ELLIPSOID:
            return [("spheres", {**at, "size": vector(2 * size)})]
        case _Geom.mjGEOM_CYLINDER:
            return [("cylinders", {**at, "size": vector(tube), **round_})]
        case _Geom.mjGEOM_CAPSULE:
            matrix = np.empty(9)
            mujoco.mju_quat2Mat(matrix, turn)
            along = matrix.reshape(3, 3)[:, 2] * size[1]
            ball = {**look, "size": vector(np.full(3, 2 * size[0]))}
            ends = [{**ball, "pose": pose(position + s * along, turn)} for s in (-1, 1)]
            tube_ = {**at, "size": vector(tube), **round_}
            return [("cylinders", tube_), *(("spheres", end) for end in ends)]
        case _Geom.mjGEOM_PLANE:
            wide = np.array([2 * (half or 50.0) for half in size[:2]] + [0.01])
            below = {**look, "pose": pose(position - [0, 0, 0.01], turn)}
            return [("cubes", {**below, "size": vector(wide)})]
        case _Geom.mjGEOM_MESH | _Geom.mjGEOM_SDF:
            return [("triangles", {**at, **_triangles(*_mesh(model, geom))})]
        case _Geom.mjGEOM_HFIELD:
            return [("triangles", {**at, **_triangles(*_field(model, geom))})]
        case _:
            return []


def _triangles(points: np.ndarray, indices: np.ndarray) -> dict[str, Any]:
    return {
        "points": [vector(point) for point in points],
        "colors": [],
        "indices": indices.ravel().tolist(),
    }


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (F, 3) of a mesh."""
    mesh = model.geom_dataid[geom]
    vertices = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    return model.mesh_vert[vertices], model.mesh_face[faces]


def _field(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (F, 3) of a height field, thinned."""
    points, triangles = height_field(model, geom, _FIELD_LINES)
    return points.reshape(-1, 3), triangles
