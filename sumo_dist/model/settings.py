"""Settings of a file that becomes part of a scene: its compiler's act, its world's do not."""

import re

import mujoco
import numpy as np
from mujoco.introspect.ast_nodes import StructFieldDecl
from mujoco.introspect.structs import STRUCTS

_FromGeom = mujoco.mjtInertiaFromGeom
_OPTIONS = tuple(
    field.name for field in STRUCTS["mjOption"].fields if isinstance(field, StructFieldDecl)
)  # in the order of the bits of `authored`
_FLAGS = ("disableflags", "enableflags", "disableactuator")
_SIZES = ("memory", "njmax", "nconmax", "nemax", "nstack", "nuserdata", "nkey")
_USER = tuple(
    f"nuser_{kind}"
    for kind in ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")
)


def carry_out_settings(spec: mujoco.MjSpec) -> None:
    """Apply those compiler settings of a file that do not go with its elements when it is attached.

    The others (units, limits, bounds of masses ...) MuJoCo keeps with the elements.
    """
    if spec.strippath:
        for asset in (*spec.meshes, *spec.hfields, *spec.textures, *spec.skins):
            asset.file = _without_folder(asset.file)
        for texture in spec.textures:
            texture.cubefiles = [_without_folder(file) for file in texture.cubefiles]
        spec.strippath = False
    # The planning model has no visual geoms, so inertia must not come from them there.
    if (
        spec.compiler.settotalmass > 0
        or spec.compiler.inertiafromgeom == _FromGeom.mjINERTIAFROMGEOM_TRUE
    ):
        _write_masses(spec)
    if spec.compiler.discardvisual:
        spec.discard_visual()
        spec.compiler.discardvisual = False


def fuse_static(spec: mujoco.MjSpec, into_world: bool) -> None:
    """Fuse bodies without joints with their parents if the file says so.

    Args:
        spec: of the file.
        into_world: what is fused with the world stays there; else nothing is fused, because masses
            would be lost of what is to move.
    """
    if spec.compiler.fusestatic and into_world:
        spec.fuse_static()
    spec.compiler.fusestatic = False


def settings_left_out(spec: mujoco.MjSpec, scene: mujoco.MjSpec) -> list[str]:
    """What a file sets for a whole world, differs from the scene's, and is left out, in words."""
    if not hasattr(spec, "authored"):  # MuJoCo 3.6, of the reference: nobody asks it for remarks
        return []
    written = [n for i, n in enumerate(_OPTIONS) if spec.authored.option >> i & 1]
    names = [
        n for n in written if not np.array_equal(*(getattr(s.option, n) for s in (spec, scene)))
    ]
    flags = ["flag"] if any(getattr(spec.authored, flag) for flag in _FLAGS) else []
    options = [name for name in names if name not in _FLAGS] + flags
    default = mujoco.MjSpec()
    sizes = [n for n in _SIZES if n != "nkey" and getattr(spec, n) != getattr(default, n)]
    words = [f"option {', '.join(options)}"] if options else []
    words += [f"size {', '.join(sizes)}"] if sizes else []
    words += ["keyframes"] if spec.keys else []
    return [f"left out {'; '.join(words)}: these are the scene's to set"] if words else []


def take_settings(spec: mujoco.MjSpec, scene: mujoco.MjSpec) -> None:
    """Give a file the scene's settings: the scene's win anyway, and MuJoCo would warn of each."""
    spec.option, spec.visual, spec.stat = scene.option, scene.visual, scene.stat
    for key in list(spec.keys):
        spec.delete(key)
    for size in (*_SIZES, *_USER):
        setattr(spec, size, getattr(scene, size))


def _write_masses(spec: mujoco.MjSpec) -> None:
    """Write into each body the mass and inertia that the file's settings come to."""
    as_written = spec.copy()  # bodies neither fused nor moved
    as_written.compiler.fusestatic = as_written.compiler.alignfree = False
    for joint in as_written.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    model = as_written.compile()
    for i, body in enumerate(spec.bodies):
        if model.body_mass[i] > 0:
            body.mass, body.inertia = model.body_mass[i], model.body_inertia[i]
            body.ipos, body.iquat = model.body_ipos[i], model.body_iquat[i]
            body.fullinertia, body.explicitinertial = np.full(6, np.nan), True
            body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.compiler.settotalmass = -1.0
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    spec.compiler.inertiafromgeom = _FromGeom.mjINERTIAFROMGEOM_AUTO


def _without_folder(file: str) -> str:
    return re.split(r"[/\\]", file)[-1]
