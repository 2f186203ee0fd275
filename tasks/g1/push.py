"""G1 pushes a box, a chair or a table along x to the origin (paper, appendix)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import SceneObject
from sumo_dist.robots.g1 import g1_actions
from sumo_dist.tasks.g1.terms import (
    FALL,
    ROBOT_FRAMES,
    WORKSPACE,
    NearReset,
    heading,
    regularisation,
    scene,
)
from sumo_dist.tasks.task import Task

SUCCESS_DISTANCE = 0.3  # released code: on each axis [m]
SUCCESS_SPEED = 0.1  # released code [m/s]
SUCCESS_HOLD = 0.5  # ours: pushed in steps, an object is slow for an instant on its way [s]
TIPPED = np.pi / 4  # beyond this tilt an object does not come back by itself [rad]
ROBOT_START = (-2.0, 0.0)  # [m]
OBJECT_START = (-1.0, 0.0)  # [m]


@dataclass(frozen=True)
class Load:
    """An object that G1 pushes.

    Attributes:
        name: of the object and its root body.
        mjcf: its model.
        rest_z: height of its origin when it stands on the floor [m].
        aim: the point that a palm is drawn to.
        goal_weight: of the distance to the goal.
        heading_weight: of facing along x; 0 leaves the term out.
        velocity_weight: of the squared speed of the object; 0 leaves the term out.
    """

    name: str
    mjcf: str
    rest_z: float
    aim: FrameRef
    goal_weight: float
    heading_weight: float = 0.0
    velocity_weight: float = 0.0


def to_goal(r: View) -> np.ndarray:
    """Distance of the object from the goal on the floor, (B, T) [m]."""
    return norm(r.object.pos[..., :2])


def lean(r: View) -> np.ndarray:
    """How far the object is from upright, |1 - z_obj . z|, (B, T)."""
    return np.abs(1.0 - r.object.z[..., 2])


def palm(r: View) -> np.ndarray:
    """Distance of the nearer palm from the object, (B, T) [m]."""
    return np.minimum(norm(r.left_palm.pos - r.aim.pos), norm(r.right_palm.pos - r.aim.pos))


def apart(r: View) -> np.ndarray:
    """Distance of the pelvis from the object, (B, T) [m]."""
    return norm(r.base.pos - r.object.pos)


def speed2(r: View) -> np.ndarray:
    """Squared speed of the object, (B, T) [m^2/s^2]."""
    return norm(r.object.linvel) ** 2


def solved(r: View) -> np.ndarray:
    """Whether the object is at its goal and slow, (B, T)."""
    away = np.maximum(np.abs(r.object.pos[..., 0]), np.abs(r.object.pos[..., 1]))
    return (away < SUCCESS_DISTANCE) & (norm(r.object.linvel) < SUCCESS_SPEED)


def tipped(r: View) -> np.ndarray:
    """Whether the object lies, (B, T)."""
    return r.object.z[..., 2] < np.cos(TIPPED)


def left(r: View) -> np.ndarray:
    """Whether robot or object are outside the workspace, (B, T)."""
    return (norm(r.object.pos) > WORKSPACE) | (norm(r.base.pos) > WORKSPACE)


def push(load: Load, arms: tuple[str, ...] = ("left", "right")) -> Task:
    """G1 pushes an object to the origin with base and arms.

    Cost (paper's appendix): w_goal ||xy_obj - goal|| + 15 |1 - z_obj . z| + 10 min ||p_palm -
    p_obj|| - 0.1 ||p_pelvis - p_obj|| - w_head x_robot . x + w_vel ||v_obj||^2 + 3 (||v_base|| +
    ||q_arm - q_def||) + 2500 if it falls, averaged over the rollout. The appendix has the body's
    y axis where the box and the table are to stay upright; that axis lies level when they do, so
    it is z here. The released code measures the palms from the world's origin; here it is from
    the object, as printed.

    Args:
        load: the object.
        arms: that are sampled; the others are the policy's.
    """
    actions = g1_actions(arms)
    terms = [
        CostTerm("goal", to_goal, load.goal_weight),
        CostTerm("upright", lean, 15.0),
        CostTerm("palm", palm, 10.0),
        CostTerm("pelvis", apart, -0.1),
    ]
    if load.heading_weight:
        terms.append(CostTerm("heading", heading, -load.heading_weight))
    if load.velocity_weight:
        terms.append(CostTerm("velocity", speed2, load.velocity_weight))
    return Task(
        name=f"g1/{load.name}_push",
        scene=scene((SceneObject(load.name, load.mjcf),)),
        actions=actions,
        frames={**ROBOT_FRAMES, "object": FrameRef("body", load.name), "aim": load.aim},
        cost=(*terms, regularisation(actions), FALL),
        reset=NearReset(ROBOT_START, {load.name: (*OBJECT_START, load.rest_z)}),
        success=solved,
        success_hold=SUCCESS_HOLD,
        failure={"tipped": tipped, "left the workspace": left},
        goal=(0.0, 0.0, load.rest_z),
        trails=("base", "object"),
    )


BOX = Load(
    "box",
    "objects/large_box.xml",
    rest_z=0.5,
    aim=FrameRef("body", "box"),
    goal_weight=50.0,
    heading_weight=50.0,
)
CHAIR = Load(
    "chair",
    "objects/chair.xml",
    rest_z=0.010,
    aim=FrameRef("site", "chair/site_object"),
    goal_weight=30.0,
    velocity_weight=10.0,
)
TABLE = Load(
    "table",
    "objects/table.xml",
    rest_z=0.0,
    aim=FrameRef("site", "table/site_object"),
    goal_weight=30.0,
)

PUSHES: dict[str, Callable[[], Task]] = {
    "g1/box_push": partial(push, BOX),
    "g1/chair_push": partial(push, CHAIR),
    "g1/table_push": partial(push, TABLE),
}
