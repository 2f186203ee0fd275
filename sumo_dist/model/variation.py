"""Variations of a compiled model: masses, inertias, friction and servo gains, as numbers."""

import copy
from dataclasses import dataclass, fields

import mujoco
import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.model.contacts import refresh


@dataclass(frozen=True)
class Spread:
    """Largest relative deviations, drawn evenly.

    Attributes:
        mass, inertia: of each link of the robot, and of each object as one piece.
        friction: sliding friction of the floor, the robot and each object.
        stiffness, damping: servo gains of each joint.
    """

    mass: float = 0.0
    inertia: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class Variation:
    """Factors on the numbers of one compiled model; its layout stays as it is.

    Attributes:
        mass, inertia: (nbody,).
        friction: (ngeom,) of sliding friction.
        stiffness, damping: (nu,) of the position servos.
    """

    mass: np.ndarray
    inertia: np.ndarray
    friction: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray


def draw(model: mujoco.MjModel, spread: Spread, rng: np.random.Generator) -> Variation:
    """Draw a variation of a model."""

    def factors(width: float, count: int) -> np.ndarray:
        return rng.uniform(1.0 - width, 1.0 + width, count)

    roots = model.body_rootid
    robot = roots[model.jnt_bodyid[model.actuator_trnid[0, 0]]]
    own = np.where(roots == robot, np.arange(model.nbody), roots)  # an object is one piece
    return Variation(
        mass=factors(spread.mass, model.nbody)[own],
        inertia=factors(spread.inertia, model.nbody)[own],
        friction=factors(spread.friction, model.nbody)[roots[model.geom_bodyid]],
        stiffness=factors(spread.stiffness, model.nu),
        damping=factors(spread.damping, model.nu),
    )


def varied(model: mujoco.MjModel, variation: Variation) -> mujoco.MjModel:
    """Return a copy of a model with a variation applied; it fits every MjData of the model's.

    Raises:
        UsageError: a variation of another model, or a factor that is not finite and positive.
    """
    _check(model, variation)
    model = copy.copy(model)
    model.body_mass[:] *= variation.mass
    model.body_inertia[:] *= variation.inertia[:, None]
    model.geom_friction[:, 0] *= variation.friction
    refresh(model)
    model.actuator_gainprm[:, 0] *= variation.stiffness
    model.actuator_biasprm[:, 1] *= variation.stiffness
    model.actuator_biasprm[:, 2] *= variation.damping
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _check(model: mujoco.MjModel, variation: Variation) -> None:
    bodies, geoms, servos = (model.nbody,), (model.ngeom,), (model.nu,)
    shapes = (bodies, bodies, geoms, servos, servos)
    for factors, shape in zip(fields(variation), shapes, strict=True):
        values = np.asarray(getattr(variation, factors.name))
        if values.shape != shape:
            raise UsageError(
                f"variation: {factors.name} has shape {values.shape}, the model needs {shape}"
            )
        if not (np.isfinite(values) & (values > 0.0)).all():
            raise UsageError(f"variation: {factors.name} has a factor that is not positive")
