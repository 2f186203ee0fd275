"""Spot pushes a box that weighs two thirds of itself to its goal (paper, appendix)."""

import numpy as np

from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import near
from sumo_dist.tasks.spot.demos.deliver import deliver
from sumo_dist.tasks.spot.demos.rack import askew
from sumo_dist.tasks.spot.terms import (
    FALL,
    OPEN_JAW,
    base_speed,
    unit,
)
from sumo_dist.tasks.task import Task

CROUCH = 0.4  # height of the torso from which it pushes (paper) [m]
BEHIND = 0.6  # of the torso from the box, on the far side of its goal (paper) [m]


def behind(r: View) -> np.ndarray:
    """Distance of the base from its place behind the box, low, (B, T) [m]."""
    box = r.object.pos[..., :2]
    off = r.base.pos[..., :2] - (box - BEHIND * unit(r.p.goal - box))
    return np.sqrt(norm(off) ** 2 + (r.base.pos[..., 2] - CROUCH) ** 2)


def box_push() -> Task:
    """Spot pushes a rugged box to its goal, crouching.

    Cost: the paper's terms and weights. The control term is of the base's velocity alone, as
    released.
    """
    actions = spot_actions(gripper=True, torso=True).within("gripper", default=OPEN_JAW)
    return deliver(
        "spot/demo_box_push",
        Scene(SPOT, (SceneObject("box", "objects/rugged_box.xml"),), floor_friction=1.0),
        0.0,
        description="Spot pushes a 20 kg box, crouching, to its goal",
        actions=actions.within("torso_height", upper=CROUCH, default=CROUCH),
        cost=(
            CostTerm("goal", terms.goal_distance("object", 0.0), 500.0),
            CostTerm("askew", askew, 50.0),
            CostTerm("torso", behind, 30.0),
            CostTerm("gripper", terms.distance("gripper", "object"), 0.1),
            CostTerm("control", base_speed, 2.0),
            FALL,
        ),
        robot=near((1.0, 0.0), 0.2, 0.3),
        where=near((0.5, 2.0), 0.2, 0.3),
        frames={},
        time_limit=90.0,
    )
