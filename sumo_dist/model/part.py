"""What a model file becomes in a scene: what is taken, what is left out, what cannot work."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from sumo_dist.errors import UsageError

_FREE = mujoco.mjtJoint.mjJNT_FREE
_PLANE = mujoco.mjtGeom.mjGEOM_PLANE
_GROUNDS = (_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
_FLAT = 1e-6  # a plane so level and so close to z = 0 is the floor [m]
STANDS_STILL = "what stands still belongs in a fixture"


def refuse(spec: mujoco.MjSpec, what: str) -> None:
    """Refuse what an object or fixture cannot have.

    Args:
        spec: of the file.
        what: the file, as messages call it.

    Raises:
        UsageError: it holds actuators or soft bodies.
    """
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


def find_root(spec: mujoco.MjSpec, what: str, name: str) -> mujoco.MjsBody | None:
    """Find the top-level body that is the object; None if all that the file holds is one object.

    It is the one that has a free joint; of several, the one called like the object, else the first.
    Without any it is the only one there is. Several without a free joint keep their places in one
    that moves, as do geoms of a file without a body.

    Args:
        spec: of the file.
        what: the file, as messages call it.
        name: of the object in the scene.

    Raises:
        UsageError: there is nothing that could move freely.
    """
    bodies = spec.worldbody.bodies
    free = [body for body in bodies if any(joint.type == _FREE for joint in body.joints)]
    named = [body for body in free or bodies if body.name == name]
    if mocap := [body for body in bodies if body.mocap and len(bodies) == 1]:
        raise UsageError(
            f"{what}: {_listed(mocap)} is a mocap body, which nothing can push: "
            "take mocap away from it, or list the file as a fixture"
        )
    if not bodies and all(geom.type in _GROUNDS for geom in spec.worldbody.geoms):
        raise UsageError(f"{what} has no body that could be an object")
    if not free and len(bodies) != 1 and not named:
        return None
    root = (named or free or bodies)[0]
    if hung := [joint for joint in root.joints if joint.type != _FREE]:
        raise UsageError(
            f"{what}: {_listed([root])} hangs in the world by {_listed(hung)}, but an object's "
            "top-level body has a free joint or none: list the file as a fixture"
        )
    return root


def leave_out_still(spec: mujoco.MjSpec, root: mujoco.MjsBody) -> list[str]:
    """Delete what an object's file holds beside the object and what moves; return it in words."""
    bodies = [body for body in spec.worldbody.bodies if body != root]
    still = [*spec.worldbody.geoms, *(body for body in bodies if not body.find_all("joint"))]
    words = [f"{_listed(still)} ({STANDS_STILL})"] if still else []
    for element in still:
        spec.delete(element)
    free = [body for body in bodies if any(joint.type == _FREE for joint in body.joints)]
    if free:
        words.append(f"a name of its own for {_listed([root])}, one of several that move freely")
    return words


def leave_out_floor(spec: mujoco.MjSpec, model: mujoco.MjModel) -> list[str]:
    """Delete the planes of a file that would lie in the scene's floor; return them in words.

    Args:
        spec: of the file, compiled.
        model: its compiled model.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    planes = np.flatnonzero(model.geom_type == _PLANE)
    level = np.abs(data.geom_xmat[planes, 8] - 1.0) < _FLAT
    floors = set(planes[level & (np.abs(data.geom_xpos[planes, 2]) < _FLAT)].tolist())
    doubled = [geom for geom in spec.geoms if geom.id in floors]
    words = [f"{_listed(doubled)} (the scene has a floor)"] if doubled else []
    for geom in doubled:
        spec.delete(geom)
    return words


def name_all(spec: mujoco.MjSpec) -> None:
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


def _listed(elements: Sequence[Any]) -> str:
    """Name elements as a file does: geom 'floor', joint 'hinge'."""
    kind = {id(e): type(e).__name__.removeprefix("Mjs").lower() for e in elements}
    return ", ".join(
        f"{kind[id(e)]} {e.name!r}" if e.name else f"a {kind[id(e)]}" for e in elements
    )
