"""Spot drags a tire rack to its goal (paper, appendix)."""

import numpy as np

from sumo_dist.costs.terms import CostTerm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import near
from sumo_dist.tasks.spot.demos.deliver import deliver
from sumo_dist.tasks.spot.terms import (
    FALL,
    LOW,
    OPEN_JAW,
    at_goal,
    dot,
    grasp_terms,
    nearest,
    until,
)
from sumo_dist.tasks.task import Task

REST_Z = 0.3  # height of its origin when it stands [m]


def askew(r: View) -> np.ndarray:
    """How far the rack's axes are from the world's, the sum of 1 - cos of each, (B, T)."""
    axes = r.object.x[..., 0] + r.object.y[..., 1] + r.object.z[..., 2]
    return 3.0 - axes


def wrist_askew(r: View) -> np.ndarray:
    """How far the wrist is from level with the rack, (B, T)."""
    return 1.0 - dot(r.wrist.z, r.object.z)


def rack_drag() -> Task:
    """Spot grips the rear cross bar of a tire rack and drags it to its goal.

    Cost: the paper's terms and weights. The axes are the world's, as printed; the released code has
    them turned by 90 degrees. Its goal is on the floor, which the origin of a standing rack is not:
    here it is at the height where it stands.
    """
    approach = nearest("base", "approach_left", "approach_mid", "approach_right")
    return deliver(
        "spot/demo_rack_drag",
        Scene(SPOT, (SceneObject("rack", "objects/heavy_rack.xml"),)),
        REST_Z,
        description="Spot grips the bar of a 10 kg tire rack and drags it to its goal",
        actions=spot_actions(gripper=True).within("gripper", default=OPEN_JAW),
        cost=(
            CostTerm("goal", terms.goal_distance("object", REST_Z), 500.0),
            CostTerm("askew", askew, 50.0),
            CostTerm("grasp point", until(at_goal, terms.distance("wrist", "grasp")), 250.0),
            CostTerm("wrist", until(at_goal, wrist_askew), 250.0),
            CostTerm("approach", until(at_goal, approach), 100.0),
            *grasp_terms(at_goal),
            CostTerm("tipped", terms.tipped("object"), 2500.0, "any"),
            LOW,
            FALL,
        ),
        robot=near((-1.5, 0.0), 0.1, 0.15),
        where=near((2.0, 0.0), 0.1, 0.15),
        frames={
            "grasp": FrameRef("site", "rack/grasp_left_mid"),
            **{
                f"approach_{side}": FrameRef("site", f"rack/approach_{side}")
                for side in ("left", "mid", "right")
            },
        },
    )
