"""G1 pushes a box, a chair or a table along x to the origin (paper, appendix)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import SceneObject
from sumo_dist.robots.g1 import g1_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.g1.terms import (
    FALL,
    MEASURED,
    PALMS,
    WORKSPACE,
    at,
    heading,
    regularisation,
    scene,
)
from sumo_dist.tasks.reset import OnFloor, Reset
from sumo_dist.tasks.success import AllBelow, Measure
from sumo_dist.tasks.task import Goal, Task

SUCCESS_DISTANCE = 0.3  # released code: on each axis [m]
SUCCESS_SPEED = 0.1  # released code [m/s]
SUCCESS_HOLD = 0.5  # ours: pushed in steps, an object is slow for an instant on its way [s]
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


def lean(r: View) -> np.ndarray:
    """How far the object is from upright, |1 - z_obj . z|, (B, T)."""
    return np.abs(1.0 - r.object.z[..., 2])


def palm(r: View) -> np.ndarray:
    """Distance of the nearer palm from the object, (B, T) [m]."""
    return np.minimum(norm(r.left_palm.pos - r.aim.pos), norm(r.right_palm.pos - r.aim.pos))


def speed2(r: View) -> np.ndarray:
    """Squared speed of the object, (B, T) [m^2/s^2]."""
    return norm(r.object.linvel) ** 2


def away(r: View) -> np.ndarray:
    """How far the object is from its goal on the axis on which it is further, (B, T) [m]."""
    return np.abs(r.object.pos[..., :2] - r.p.goal).max(axis=-1)


def push(load: Load, arms: tuple[str, ...] = ("left", "right")) -> Task:
    """G1 pushes an object to its goal with base and arms; the goal is the origin by default.

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
    cost = [
        CostTerm("goal", terms.goal_distance("object"), load.goal_weight),
        CostTerm("upright", lean, 15.0),
        CostTerm("palm", palm, 10.0),
        CostTerm("pelvis", terms.distance("base", "object"), -0.1),
    ]
    if load.heading_weight:
        cost.append(CostTerm("heading", heading, -load.heading_weight))
    if load.velocity_weight:
        cost.append(CostTerm("velocity", speed2, load.velocity_weight))
    return Task(
        name=f"g1/{load.name}_push",
        scene=scene((SceneObject(load.name, load.mjcf),)),
        actions=actions,
        frames={**PALMS, "object": FrameRef("body", load.name), "aim": load.aim},
        cost=(*cost, regularisation(actions), FALL),
        parameters=(
            Parameter("goal", (0.0, 0.0), "m", (-WORKSPACE, WORKSPACE)),
            Parameter("success_distance", SUCCESS_DISTANCE, "m", (0.0, 1.0)),
            Parameter("success_speed", SUCCESS_SPEED, "m/s", (0.0, 1.0)),
        ),
        reset=Reset(at(*ROBOT_START), (OnFloor(load.name, at(*OBJECT_START), load.rest_z),)),
        success=AllBelow(
            Measure("object to goal", away, "success_distance"),
            Measure("object's speed", terms.speed("object"), "success_speed"),
        ),
        success_hold=SUCCESS_HOLD,
        failure={
            "tipped": terms.tipped("object"),
            "left the workspace": terms.outside(WORKSPACE, "object", "base"),
        },
        goal=Goal("object", load.rest_z),
        trails=("base", "object"),
        planner=MEASURED,
        description=f"G1 pushes the {load.name} to its goal and leaves it at rest",
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
