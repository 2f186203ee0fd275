"""Putting things on the floor: how low a body reaches, and the stance a robot starts from."""

import mujoco
import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, Scene, build_spec, compile_model
from sumo_dist.robots.robot import Robot

LOST = 5.0  # what has sunk farther than this falls for ever [m]
_FAR = 1e3  # distances are reported up to here [m]


def height_above_floor(model: mujoco.MjModel, qpos: np.ndarray, body: str) -> float:
    """Height of the lowest point that can touch, negative where it lies below the floor [m].

    Args:
        model: a compiled scene.
        qpos: (nq,).
        body: a top-level body; all that hangs on it counts.

    Raises:
        UsageError: nothing of it can touch.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    floor = model.geom("floor/ground").id
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    geoms = np.flatnonzero(solid & _belongs(model, body))
    if not len(geoms):
        raise UsageError(f"{body!r} cannot lie on the floor: {why_it_falls(model, body)}")
    return min(mujoco.mj_geomDistance(model, data, floor, geom, _FAR, None) for geom in geoms)


def why_it_falls(model: mujoco.MjModel, body: str) -> str:
    """Say why the floor does not hold up what hangs on a top-level body."""
    floor, of_it = model.geom("floor/ground"), _belongs(model, body)
    meets = (model.geom_contype & floor.conaffinity) | (model.geom_conaffinity & floor.contype)
    flat = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    if not of_it.any():
        return "it has no geom"
    if not meets[of_it].any():
        return "none of its geoms touches the floor, see their contype and conaffinity"
    if np.isin(model.geom_type[of_it & (meets != 0)], flat).all():
        return "planes and height fields pass through the floor, give it geoms of other types"
    return "no geom of it that touches the floor is above it, or its contacts are excluded"


def _belongs(model: mujoco.MjModel, body: str) -> np.ndarray:
    """(ngeom,) whether a geom hangs on a top-level body."""
    return model.body_rootid[model.geom_bodyid] == model.body(body).id


def without_robot(scene: Scene) -> mujoco.MjModel:
    """Compile the plant's model of a scene from which the robot is taken away."""
    spec = build_spec(scene, PLANT)
    spec.delete(spec.body(scene.robot.base))
    return spec.compile()


def settled_stand(robot: Robot) -> np.ndarray:
    """Return qpos (7 + joints,) of the robot standing at the origin, yaw 0, its feet on the floor.

    The height comes from kinematics: at the nominal one the feet may be in the floor, which would
    throw the robot up. Nothing is simulated: held by its servos alone the robot sinks.
    """
    model = compile_model(Scene(robot), PLANT)
    index = StateIndex(model)
    qpos = model.qpos0.copy()
    base = qpos[index.pose(robot.base)]
    base[:] = [0.0, 0.0, robot.stand_height, 1.0, 0.0, 0.0, 0.0]
    positions, _ = index.joints(robot.joints)
    qpos[positions] = robot.stand
    base[2] -= height_above_floor(model, qpos, robot.base)
    return qpos
