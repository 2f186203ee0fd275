"""What the G1 tasks share: cost terms of the paper's appendix, and where a trial starts."""

import numpy as np

from sumo_dist.costs.terms import CostTerm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import FloorDraw, near

FLOOR_FRICTION = 1.0
WORKSPACE = 6.0  # what is farther from the origin cannot be fetched within an episode [m]
CONTROL_WEIGHT = 3.0
# The horizon is the released code's. G1 walks faster after the mean of the best plans than after
# the best one (docs/results/search.md).
MEASURED = {"optimizer": "cem", "horizon": 2.5, "nodes": 7, "base_noise": 1.0}

# The paper's trials start alike. Ours differ by these, drawn uniformly, so that a rate over seeds
# says more than one trial repeated.
POSITION_NOISE = 0.05  # of robot and object on both axes [m]
YAW_NOISE = 0.1  # of robot and object [rad]

PALMS = {
    "left_palm": FrameRef("site", "left_palm"),
    "right_palm": FrameRef("site", "right_palm"),
}
FALL = CostTerm("fall", terms.low(G1), terms.FALL_WEIGHT, "any")


def scene(objects: tuple[SceneObject, ...] = (), fixtures: tuple[SceneObject, ...] = ()) -> Scene:
    """Return G1 on a floor whose friction yields to that of whatever stands on it."""
    return Scene(G1, objects, fixtures, floor_friction=FLOOR_FRICTION, floor_priority=0)


def at(x: float, y: float) -> FloorDraw:
    """Draw at a place, give or take the noise above."""
    return near((x, y), POSITION_NOISE, YAW_NOISE)


def heading(r: View) -> np.ndarray:
    """How far the robot faces along world x, (B, T), 1 for straight on."""
    return r.base.x[..., 0]


def regularisation(actions: ActionSpace) -> CostTerm:
    """Build the term 3 (||v_base|| + ||q_arm - q_def||) of an action space."""
    return CostTerm("control", terms.effort(actions.default), CONTROL_WEIGHT)
