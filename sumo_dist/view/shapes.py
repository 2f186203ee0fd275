"""A geom of a compiled model as a Rerun shape, with the colour or texture that MuJoCo gives it."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr

from sumo_dist.model.visible import height_field, rgba
from sumo_dist.view.marks import Color

HFIELD_LINES = 100  # of a height field that are drawn in each direction, at most
TEXTURE_PIXELS = 256  # of a texture in each direction, at most
TWIN_FACES = 1500  # of a mesh; one with more has the box around it as its twin
GROUND = (66, 72, 83)

_TWIN_ALPHA = 110
_FLOOR = "floor/ground"  # the scene's own, which every task has
_Geom = mujoco.mjtGeom
_RGB = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)

Shape = tuple[rr.AsComponents, np.ndarray]
"""A Rerun shape, and where its origin lies in the geom's frame."""


@dataclass(frozen=True)
class _Look:
    """How a geom is drawn: as it is, or as the pale twin of one."""

    color: np.ndarray | tuple[int, ...]
    twin: bool

    @property
    def solid(self) -> dict:
        fills = rr.components.FillMode
        fill = fills.TransparentFillMajorWireframe if self.twin else fills.Solid
        return {"colors": [self.color], "fill_mode": fill}


def shape(model: mujoco.MjModel, geom: int, twin: Color | None = None) -> Shape | None:
    """Return a geom's shape; None for a kind that is not drawn.

    Args:
        model: of the scene.
        geom: its number.
        twin: translucent in this colour, a large mesh by the box around it; None for as it is.
    """
    kind = _Geom(model.geom_type[geom])
    if kind not in _SHAPES:
        return None
    look = _Look(color(model, geom), False)
    if twin is not None:
        look = _Look((*twin, _TWIN_ALPHA), True)
    if look.twin and kind in _MESHES and model.mesh_facenum[model.geom_dataid[geom]] > TWIN_FACES:
        centre, half = np.split(model.geom_aabb[geom], 2)
        return rr.Boxes3D(half_sizes=[half], **look.solid), centre
    return _SHAPES[kind](model, geom, look)


def color(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return a geom's RGBA (4,) uint8, by MuJoCo's rule: its own colour, else the material's.

    A texture tints it by its mean, but where it is drawn itself. What MuJoCo draws not at all is
    opaque here: it is only drawn where nothing else of the thing is.
    """
    found = rgba(model, geom).astype(float)
    texture = _texture(model, geom)
    if texture is not None and not _has_texcoords(model, geom):
        found[:3] *= texture.reshape(-1, texture.shape[2])[:, :3].mean(axis=0) / 255.0
    found[3] = found[3] or 1.0
    return (found.clip(0.0, 1.0) * 255).round().astype(np.uint8)


def _texture(model: mujoco.MjModel, geom: int) -> np.ndarray | None:
    """Pixels (height, width, channels) of a geom's texture, thinned; None if it has none."""
    material = model.geom_matid[geom]
    number = model.mat_texid[material, _RGB] if material >= 0 else -1
    if number < 0 or model.tex_nchannel[number] < 3:
        return None
    shape_ = model.tex_height[number], model.tex_width[number], model.tex_nchannel[number]
    first = model.tex_adr[number]
    pixels = model.tex_data[first : first + np.prod(shape_)].reshape(shape_)
    return pixels[:: _stride(shape_[0]), :: _stride(shape_[1])]


def _stride(pixels: int) -> int:
    return -(-int(pixels) // TEXTURE_PIXELS)


def _has_texcoords(model: mujoco.MjModel, geom: int) -> bool:
    mesh = model.geom_dataid[geom]
    is_mesh = model.geom_type[geom] == _Geom.mjGEOM_MESH
    return bool(is_mesh and model.mesh_texcoordadr[mesh] >= 0)


def _ellipsoid(model: mujoco.MjModel, geom: int, look: _Look) -> Shape:
    size = model.geom_size[geom]
    radii = size if model.geom_type[geom] == _Geom.mjGEOM_ELLIPSOID else np.repeat(size[0], 3)
    return rr.Ellipsoids3D(half_sizes=[radii], **look.solid), np.zeros(3)


def _capsule(model: mujoco.MjModel, geom: int, look: _Look) -> Shape:
    radius, half, _ = model.geom_size[geom]
    capsule = rr.Capsules3D(lengths=[2 * half], radii=[radius], **look.solid)
    return capsule, np.array([0.0, 0.0, -half])  # Rerun's capsules start at their origin


def _cylinder(model: mujoco.MjModel, geom: int, look: _Look) -> Shape:
    radius, half, _ = model.geom_size[geom]
    return rr.Cylinders3D(lengths=[2 * half], radii=[radius], **look.solid), np.zeros(3)


def _box(model: mujoco.MjModel, geom: int, look: _Look) -> Shape:
    return rr.Boxes3D(half_sizes=[model.geom_size[geom]], **look.solid), np.zeros(3)


def _plane(model: mujoco.MjModel, geom: int, look: _Look) -> Shape:
    x, y = (half or 50.0 for half in model.geom_size[geom][:2])  # 0 is MuJoCo's infinite
    thin = 0.005
    paint = GROUND if model.geom(geom).name == _FLOOR else look.color
    slab = rr.Boxes3D(half_sizes=[[x, y, thin]], colors=[paint], fill_mode="solid")
    return slab, np.array([0.0, 0.0, -2 * thin])  # below the grid lines and what stands on it


def _hfield(model: mujoco.MjModel, geom: int, look: _Look) -> Shape:
    points, triangles = height_field(model, geom, HFIELD_LINES)
    slope_y, slope_x = np.gradient(points[..., 2], points[:, 0, 1], points[0, :, 0])
    mesh = rr.Mesh3D(
        vertex_positions=points.reshape(-1, 3),
        vertex_normals=np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], -1).reshape(-1, 3),
        triangle_indices=triangles,
        albedo_factor=look.color,
    )
    return mesh, np.zeros(3)


def _mesh(model: mujoco.MjModel, geom: int, look: _Look) -> Shape:
    mesh = model.geom_dataid[geom]
    first = model.mesh_faceadr[mesh]
    faces = slice(first, first + model.mesh_facenum[mesh])
    corners = [model.mesh_face[faces], model.mesh_facenormal[faces]]  # (faces, 3) each
    texture = None if look.twin else _texture(model, geom)
    if texture is not None and _has_texcoords(model, geom):
        corners.append(model.mesh_facetexcoord[faces])
    # In MuJoCo a vertex has another normal, and place in a texture, on each face that it is in.
    kinds = np.stack(corners, axis=-1).reshape(3 * len(corners[0]), -1)
    vertices, indices = np.unique(kinds, axis=0, return_inverse=True)
    textured = {}
    if texture is not None and len(corners) == 3:
        places = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + vertices[:, 2]]
        textured = {"vertex_texcoords": places, "albedo_texture": texture}
    triangles = rr.Mesh3D(
        vertex_positions=model.mesh_vert[model.mesh_vertadr[mesh] + vertices[:, 0]],
        vertex_normals=model.mesh_normal[model.mesh_normaladr[mesh] + vertices[:, 1]],
        triangle_indices=indices.reshape(-1, 3),
        albedo_factor=look.color,
        **textured,
    )
    return triangles, np.zeros(3)


_MESHES = (_Geom.mjGEOM_MESH, _Geom.mjGEOM_SDF)
_SHAPES: dict[mujoco.mjtGeom, Callable[[mujoco.MjModel, int, _Look], Shape]] = {
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
