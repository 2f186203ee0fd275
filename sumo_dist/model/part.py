"""What a model file becomes in a scene: what is taken, what is left out, what cannot work."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.model.files import find_model, read_model, valid_model
from sumo_dist.model.references import count_referring
from sumo_dist.model.settings import carry_out_settings, fuse_static

_FREE = mujoco.mjtJoint.mjJNT_FREE
_PLANE = mujoco.mjtGeom.mjGEOM_PLANE
_GROUNDS = (_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
_FLAT = 1e-6  # a plane so level and so close to z = 0 is the floor [m]


@dataclass(frozen=True)
class Part:
    """A model file that is ready to be attached.

    Attributes:
        spec: all of it that is taken; every body and joint has a name.
        root: of an object, with its free joint; None if all of it is to move as one, or is fixed.
        floors: planes that would lie in the scene's floor: they go, and the scene's stands in.
        remarks: what there is to say about the file.
        referring: how many elements of the file refer to others; see `count_referring`.
    """

    spec: mujoco.MjSpec
    root: mujoco.MjsBody | None = None
    floors: Sequence[mujoco.MjsGeom] = ()
    remarks: Sequence[str] = ()
    referring: Counter[str] = field(default_factory=Counter)


def read_part(file: str, name: str, free: bool) -> Part:
    """Read an object's (free) or a fixture's file.

    An object is the body of the file that has a free joint, or its only body, which gets one; what
    stands still beside it is left out. If there is no such body, all that the file holds is one
    object. A fixture is all that the file holds, and hangs in the world as it does there.

    Args:
        file: see `find_model`.
        name: of the object or fixture in the scene.
        free: it is an object.

    Raises:
        UsageError: the file is missing, is no valid model or holds what cannot work in a scene.
    """
    with valid_model(file):
        spec = read_model(find_model(file), file)
        _refuse(spec, file)
        carry_out_settings(spec)
        root = _find_root(spec, file, name) if free else None
        remarks = _which_root(spec, root, name) if free else []
        if root and not root.joints:
            root.add_freejoint()
        fuse_static(spec, into_world=not free or root is not None)
        floors = _doubled_floors(spec)
        referring = count_referring(spec)
        if root:
            floors = [geom for geom in floors if geom in spec.worldbody.geoms]
            remarks += _leave_out_still(spec, root, floors)
        lights = spec.worldbody.lights  # those of bodies stay
        own = {"a floor": floors, "lights": lights}
        remarks += [f"left out {_listed(of)}: the scene has {a}" for a, of in own.items() if of]
        for light in lights:
            spec.delete(light)
        _name_all(spec)
    return Part(spec, root, floors, remarks, referring)


def _refuse(spec: mujoco.MjSpec, what: str) -> None:
    """Refuse what neither an object nor a fixture can have: actuators and soft bodies."""
    if spec.actuators:
        raise UsageError(
            f"{what} has actuators, {_listed(spec.actuators)}, which nothing would drive: only the "
            "robot's are; remove them (stiffness and springref hold a joint, damping slows it)"
        )
    if spec.flexes:
        raise UsageError(
            f"{what} has soft bodies, {_listed(spec.flexes)}, which cannot be rolled out: "
            "make it of rigid bodies, with joints between them if it is to bend"
        )


def _find_root(spec: mujoco.MjSpec, what: str, name: str) -> mujoco.MjsBody | None:
    """Find the top-level body that is the object; None if all that the file holds is one object.

    Of several with a free joint it is the one called like the object, else the first.
    """
    mocap = [body for body in spec.worldbody.bodies if body.mocap]
    bodies = [body for body in spec.worldbody.bodies if not body.mocap]
    free = _free(bodies)
    if mocap and not free and len(bodies) != 1:
        raise UsageError(
            f"{what}: {_listed(mocap)} is a mocap body, which nothing can push: "
            "take mocap away from it, or list the file as a fixture"
        )
    if not bodies and all(geom.type in _GROUNDS for geom in spec.worldbody.geoms):
        raise UsageError(f"{what} has no body that could be an object")
    if not free and len(bodies) != 1:
        return None
    root = next((body for body in free if body.name == name), (free or bodies)[0])
    if hung := [joint for joint in root.joints if joint.type != _FREE]:
        raise UsageError(
            f"{what}: {_listed([root])} hangs in the world by {_listed(hung)}, but an object's "
            "top-level body has a free joint or none: list the file as a fixture"
        )
    return root


def _doubled_floors(spec: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    """Compile a file, alone so that an error is its own; find its planes in the scene's floor."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    planes = np.flatnonzero(model.geom_type == _PLANE)
    level = np.abs(data.geom_xmat[planes, 8] - 1.0) < _FLAT
    floors = planes[level & (np.abs(data.geom_xpos[planes, 2]) < _FLAT)].tolist()
    return [geom for geom in spec.geoms if geom.id in floors]


def _leave_out_still(
    spec: mujoco.MjSpec, root: mujoco.MjsBody, floors: Sequence[mujoco.MjsGeom]
) -> list[str]:
    """Delete what an object's file holds beside the object and stands still; say what that was."""
    geoms = [geom for geom in spec.worldbody.geoms if geom not in floors]
    bodies = [body for body in spec.worldbody.bodies if body != root]
    still = [*geoms, *(body for body in bodies if not body.find_all("joint"))]
    words = [f"left out {_listed(still)}: what stands still belongs in a fixture"] if still else []
    for element in still:
        spec.delete(element)
    return words


def _which_root(spec: mujoco.MjSpec, root: mujoco.MjsBody | None, name: str) -> list[str]:
    """Say which of a file's bodies the object is, if it holds several that it might be."""
    bodies = spec.worldbody.bodies
    if root is None and len(bodies) > 1:
        return [f"{_listed(bodies)} move as one object: none of them has a free joint"]
    if root is None or root.name == name or len(_free(bodies)) < 2:
        return []
    return [
        f"object {name!r} is {_listed([root])}, the first of several that move freely "
        "(call the object like the one it is to be)"
    ]


def _name_all(spec: mujoco.MjSpec) -> None:
    """Name the bodies and joints of a file that it leaves unnamed: body_3, joint_1."""
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints)):
        known = {element.name for element in elements}
        for number, element in enumerate(elements):
            if not element.name:
                label = f"{kind}_{number}"
                while label in known:
                    label += "_"
                element.name = label
                known.add(label)


def _free(bodies: Iterable[mujoco.MjsBody]) -> list[mujoco.MjsBody]:
    return [body for body in bodies if any(joint.type == _FREE for joint in body.joints)]


def _listed(elements: Iterable[Any]) -> str:
    """Name elements of a file as a file does: geom 'floor', joint 'hinge'."""
    kinds = ((type(e).__name__.removeprefix("Mjs").lower(), e.name) for e in elements)
    return ", ".join(f"{kind} {name!r}" if name else f"an unnamed {kind}" for kind, name in kinds)
