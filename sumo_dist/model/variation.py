"""Variations of a compiled model: masses, sizes, friction and servo gains, as numbers."""

import copy
from dataclasses import dataclass, fields

import mujoco
import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.model.contacts import refresh
from sumo_dist.model.index import label

_Geom = mujoco.mjtGeom
PRIMITIVE = tuple(
    int(kind)
    for kind in (
        *(_Geom.mjGEOM_SPHERE, _Geom.mjGEOM_CAPSULE, _Geom.mjGEOM_ELLIPSOID),
        *(_Geom.mjGEOM_CYLINDER, _Geom.mjGEOM_BOX),
    )
)


@dataclass(frozen=True)
class Spread:
    """Largest relative deviations, drawn evenly.

    Attributes:
        mass, inertia: of each link of the robot, and of each object as one piece.
        friction: sliding friction of the floor, the robot and each object.
        stiffness, damping: servo gains of each joint.
        size: of each object as one piece; its mass stays.
    """

    mass: float = 0.0
    inertia: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    size: float = 0.0


@dataclass(frozen=True, eq=False)
class Variation:
    """Factors on the numbers of one compiled model; its layout stays as it is.

    Attributes:
        mass, inertia: (nbody,).
        friction: (ngeom,) of sliding friction.
        stiffness, damping: (nu,) of the position servos.
        size: (nbody,) of all lengths, 1 for the robot. Its inertia grows with the square, on top of
            the factor of its own.
    """

    mass: np.ndarray
    inertia: np.ndarray
    friction: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    size: np.ndarray


def draw(model: mujoco.MjModel, spread: Spread, rng: np.random.Generator) -> Variation:
    """Draw a variation of a model."""

    def factors(width: float, count: int) -> np.ndarray:
        return rng.uniform(1.0 - width, 1.0 + width, count)

    roots = model.body_rootid
    robot = roots[model.jnt_bodyid[model.actuator_trnid[0, 0]]]
    ones = np.ones(model.nbody)
    own = np.where(roots == robot, np.arange(model.nbody), roots)  # an object is one piece
    return Variation(
        mass=factors(spread.mass, model.nbody)[own],
        inertia=factors(spread.inertia, model.nbody)[own],
        friction=factors(spread.friction, model.nbody)[roots[model.geom_bodyid]],
        stiffness=factors(spread.stiffness, model.nu),
        damping=factors(spread.damping, model.nu),
        size=_sizes(model, robot, factors(spread.size, model.nbody)) if spread.size else ones,
    )


def _sizes(model: mujoco.MjModel, robot: int, factors: np.ndarray) -> np.ndarray:
    """Give each thing that moves, but for the robot, one of the factors (nbody,); 1 to the rest."""
    roots = model.body_rootid
    moves = (model.body_dofnum[roots] > 0) & (roots != robot)
    return np.where(moves, factors[roots], 1.0)


def varied(model: mujoco.MjModel, variation: Variation) -> mujoco.MjModel:
    """Return a copy of a model with a variation applied; it fits every MjData of the model's.

    Raises:
        UsageError: a variation of another model, a factor that is not finite and positive, or an
            object that cannot have another size.
    """
    _check(model, variation)
    model = copy.copy(model)
    for body in np.flatnonzero(variation.size != 1.0):
        _resize(model, int(body), float(variation.size[body]))
    model.body_mass[:] *= variation.mass
    model.body_inertia[:] *= variation.inertia[:, None]
    model.geom_friction[:, 0] *= variation.friction
    refresh(model)
    model.actuator_gainprm[:, 0] *= variation.stiffness
    model.actuator_biasprm[:, 1] *= variation.stiffness
    model.actuator_biasprm[:, 2] *= variation.damping
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _resize(model: mujoco.MjModel, body: int, factor: float) -> None:
    """Make all lengths of a body longer by a factor, in place; the pose of a root stays."""
    geoms = np.flatnonzero(model.geom_bodyid == body)
    for geom in geoms:
        if model.geom_type[geom] not in PRIMITIVE:
            raise UsageError(
                f"variation: {label(model, 'body', body)!r} cannot have another size: its geom "
                f"{label(model, 'geom', int(geom))!r} is no sphere, capsule, ellipsoid, cylinder "
                "or box"
            )
    model.geom_size[geoms] *= factor
    model.geom_pos[geoms] *= factor
    model.geom_aabb[geoms] *= factor
    model.geom_rbound[geoms] *= factor
    model.site_pos[model.site_bodyid == body] *= factor
    model.jnt_pos[model.jnt_bodyid == body] *= factor
    first, count = model.body_bvhadr[body], model.body_bvhnum[body]
    model.bvh_aabb[first : first + count] *= factor
    model.body_ipos[body] *= factor
    model.body_inertia[body] *= factor**2
    if model.body_parentid[body] != 0:
        model.body_pos[body] *= factor


def _check(model: mujoco.MjModel, variation: Variation) -> None:
    bodies, geoms, servos = (model.nbody,), (model.ngeom,), (model.nu,)
    shapes = (bodies, bodies, geoms, servos, servos, bodies)
    for factors, shape in zip(fields(variation), shapes, strict=True):
        values = np.asarray(getattr(variation, factors.name))
        if values.shape != shape:
            raise UsageError(
                f"variation: {factors.name} has shape {values.shape}, the model needs {shape}"
            )
        if not (np.isfinite(values) & (values > 0.0)).all():
            raise UsageError(f"variation: {factors.name} has a factor that is not positive")
