"""What refers by name to a body, joint or geom of a model file, and how that is kept up."""

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from operator import setitem
from typing import Any

import mujoco

_Obj = mujoco.mjtObj
_KINDS = {
    mujoco.MjsBody: (_Obj.mjOBJ_BODY, _Obj.mjOBJ_XBODY),
    mujoco.MjsJoint: (_Obj.mjOBJ_JOINT,),
    mujoco.MjsGeom: (_Obj.mjOBJ_GEOM,),
}
_REFERRING = ("pairs", "excludes", "equalities", "tendons", "sensors", "tuples", "skins")


def refer(spec: mujoco.MjSpec, element: Any) -> Callable[[str], None]:
    """Return what makes all that refers to a body, joint or geom by name refer to another one.

    Call this before the spec is attached, which puts a prefix on names, and the result after.
    """
    references = list(_references(spec, _KINDS[type(element)], element.name))

    def to(name: str) -> None:
        for write in references:
            write(name)

    return to


def count_referring(spec: mujoco.MjSpec) -> Counter[str]:
    """How many there are of each kind of element that refers to others."""
    return Counter({kind: len(getattr(spec, kind)) for kind in _REFERRING})


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
    if _Obj.mjOBJ_GEOM in kinds:
        scalars += [(p, attribute) for p in spec.pairs for attribute in ("geomname1", "geomname2")]
    for element, attribute in scalars:
        if name and getattr(element, attribute) == name:
            yield partial(setattr, element, attribute)
    for names, i in lists:
        if name and names[i] == name:
            yield partial(setitem, names, i)
