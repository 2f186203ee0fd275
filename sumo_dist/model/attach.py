"""Attaching a file to a scene: its own settings act, the scene's options win, references hold."""

import re
from collections.abc import Callable, Iterator
from functools import partial
from operator import setitem
from typing import Any

import mujoco
import numpy as np
from mujoco.introspect.structs import STRUCTS

_Obj = mujoco.mjtObj
_OPTIONS = tuple(field.name for field in STRUCTS["mjOption"].fields)
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
    if spec.compiler.settotalmass > 0:
        _write_masses(spec)
    if spec.compiler.discardvisual:
        spec.discard_visual()
        spec.compiler.discardvisual = False


def fuse_static(spec: mujoco.MjSpec) -> None:
    """Fuse bodies without joints with their parents if the file says so."""
    if spec.compiler.fusestatic:
        spec.fuse_static()
        spec.compiler.fusestatic = False


def settings_left_out(spec: mujoco.MjSpec, scene: mujoco.MjSpec) -> list[str]:
    """What a file sets for a whole world, differs from the scene's, and is not taken; in words."""
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
    return words + (["keyframes"] if spec.keys else [])


def take_settings(spec: mujoco.MjSpec, scene: mujoco.MjSpec) -> None:
    """Give a file the scene's settings: the scene's win anyway, and MuJoCo would warn of each."""
    spec.option, spec.visual, spec.stat = scene.option, scene.visual, scene.stat
    for key in list(spec.keys):
        spec.delete(key)
    for size in (*_SIZES, *_USER):
        setattr(spec, size, getattr(scene, size))


def rename(spec: mujoco.MjSpec, element: mujoco.MjsBody | mujoco.MjsJoint) -> Callable[[str], None]:
    """Return what gives a body or joint another name, with all that refers to it.

    Call this before the spec is attached, which puts a prefix on names, and the result after.
    """
    kinds = (_Obj.mjOBJ_BODY, _Obj.mjOBJ_XBODY)
    if isinstance(element, mujoco.MjsJoint):
        kinds = (_Obj.mjOBJ_JOINT,)
    references = list(_references(spec, kinds, element.name)) if element.name else []

    def to(name: str) -> None:
        element.name = name
        for write in references:
            write(name)

    return to


def _references(
    spec: mujoco.MjSpec, kinds: tuple[mujoco.mjtObj, ...], name: str
) -> Iterator[Callable[[str], None]]:
    """What writes another name wherever an element refers to one of these kinds by this name."""
    typed = [(s, "objtype", "objname") for s in spec.sensors]
    typed += [(s, "reftype", "refname") for s in spec.sensors]
    typed += [
        (e, "objtype", attribute) for e in spec.equalities for attribute in ("name1", "name2")
    ]
    scalars: list[tuple[Any, str]] = [(e, attr) for e, of, attr in typed if getattr(e, of) in kinds]
    lists = [
        (t.objname, i) for t in spec.tuples for i, kind in enumerate(t.objtype) if kind in kinds
    ]
    if _Obj.mjOBJ_BODY in kinds:
        scalars += [(e, attr) for e in spec.excludes for attr in ("bodyname1", "bodyname2")]
        scalars += [(e, "targetbody") for e in (*spec.cameras, *spec.lights)]
        lists += [(s.bodyname, i) for s in spec.skins for i in range(len(s.bodyname))]
    for element, attribute in scalars:
        if getattr(element, attribute) == name:
            yield partial(setattr, element, attribute)
    for names, i in lists:
        if names[i] == name:
            yield partial(setitem, names, i)


def _write_masses(spec: mujoco.MjSpec) -> None:
    """Write into each body the mass and inertia that the file's settings come to."""
    model = spec.copy().compile()
    for i, body in enumerate(spec.bodies):
        if model.body_mass[i] > 0:
            body.mass, body.inertia = model.body_mass[i], model.body_inertia[i]
            body.ipos, body.iquat = model.body_ipos[i], model.body_iquat[i]
            body.fullinertia, body.explicitinertial = np.full(6, np.nan), True
            body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.compiler.settotalmass = -1.0
    spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO


def _without_folder(file: str) -> str:
    return re.split(r"[/\\]", file)[-1]
