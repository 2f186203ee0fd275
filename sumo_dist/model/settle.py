"""Putting things on the floor: how low a body reaches, and the stance a robot starts from."""

import mujoco
import numpy as np

from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, Scene, compile_model
from sumo_dist.robots.robot import Robot

_FAR = 1e3  # distances are reported up to here [m]


def height_above_floor(model: mujoco.MjModel, qpos: np.ndarray, body: str) -> float:
    """Height of the lowest point that can touch, negative where it lies below the floor [m].

    Args:
        model: a compiled scene.
        qpos: (nq,).
        body: a top-level body; all that hangs on it counts.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    floor, root = model.geom("floor/ground").id, model.body(body).id
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    geoms = np.flatnonzero(solid & (model.body_rootid[model.geom_bodyid] == root))
    return min(mujoco.mj_geomDistance(model, data, floor, geom, _FAR, None) for geom in geoms)


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
