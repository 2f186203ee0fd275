"""Spot pushes a chair up a ramp and leaves it on the platform (released code)."""

import numpy as np

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import OnFloor, Reset, near
from sumo_dist.tasks.spot.analysis import CHAIR
from sumo_dist.tasks.spot.families import LEFT, SUCCESS_SPEED, SUCCESS_TILT, Z_UP
from sumo_dist.tasks.spot.terms import FALL, HOLD, base_speed
from sumo_dist.tasks.success import AllBelow, Measure
from sumo_dist.tasks.task import Task

SCENE = Scene(
    SPOT,
    (SceneObject("chair", CHAIR.mjcf),),
    (SceneObject("ramp", "fixtures/ramp.xml"),),
)
HEIGHT = 0.25  # of the platform [m]
CENTRE = np.array([1.875, 4.802])  # of the platform [m]
HALF = np.array([1.215, 0.61])  # its half size [m]
FOOT = 2.2  # y at which the ramp begins [m]
CASTORS = 0.2  # radius on which the chair stands [m]
GOAL = (2.0, 4.5, HEIGHT + CHAIR.rest_z)
MIDDLE = 2.0  # x along which the chair goes up [m]
LANE = 1.0  # half width of the way up [m]
FAR_END = 5.25  # y beyond which the chair is about to fall off the platform [m]
ROBOT_END = 4.5  # y beyond which the robot is about to [m]
TIPPED = np.arcsin(0.4)  # tilt at which the chair counts as tipped [rad]


def to_goal(r: View) -> np.ndarray:
    """Distance of the chair from its place on the platform, (B, T) [m]."""
    return norm(r.object.pos - np.array(GOAL))


def off_lane(r: View) -> np.ndarray:
    """Whether the chair is beside the way up, or at the platform's far end, (B, T) bool."""
    x, y = r.object.pos[..., 0], r.object.pos[..., 1]
    return (np.abs(x - MIDDLE) >= LANE) | (y >= FAR_END)


def beyond_edge(r: View) -> np.ndarray:
    """How far the castors reach over the platform's edge, (B, T) [m]."""
    off = np.abs(r.object.pos[..., :2] - CENTRE) - HALF
    return np.maximum(off.max(axis=-1) + CASTORS, 0.0)


def below_platform(r: View) -> np.ndarray:
    """How far the chair's origin is below where it stands on the platform, (B, T) [m]."""
    return GOAL[2] - r.object.pos[..., 2]


def beside_the_ramp(r: View) -> np.ndarray:
    """Whether the chair is past the ramp's foot and not on it, (B, T) bool."""
    x, y = r.object.pos[..., 0], r.object.pos[..., 1]
    return (np.abs(x - CENTRE[0]) > HALF[0]) & (y > FOOT)


def on_the_incline(r: View) -> np.ndarray:
    """Whether the chair is past the ramp's foot and not on its platform yet, (B, T) bool."""
    y = r.object.pos[..., 1]
    return (y > FOOT) & (y < CENTRE[1] - HALF[1])


def chair_ramp() -> Task:
    """Spot pushes a chair up a ramp of 7.2 degrees, on which it rolls back if let go.

    Cost: the released code's terms and weights. Where it sums over 100 steps and averages all
    else, the weight is 100 times as much. Ours: the goal is at the height at which the chair
    stands on the platform, not 0.24 m above; a tilt to any side counts as tipped, not only
    forward and back; the gripper is drawn to the middle of the chair, as when it is moved, not to
    the floor below. The ramp meets the floor, where the released one begins with a step of 12 mm.
    Success is a chair with all castors on the platform, upright and at rest; released, it could
    be lying, rolling, or half over the edge. The robot starts around the mean of the chair's
    places, not around the one that was drawn.
    """
    tipped = terms.tipped("object", TIPPED)
    return Task(
        name="spot/chair_ramp",
        scene=SCENE,
        actions=spot_actions(),
        frames=CHAIR.frames,
        cost=(
            CostTerm("goal", to_goal, 100.0),
            CostTerm("tipped", tipped, 10000.0, "share"),
            CostTerm("torso", terms.distance("base", "object"), -0.25),
            CostTerm("gripper", terms.distance("gripper", "aim"), 4.0),
            CostTerm("velocity", terms.speed("object"), 128.0, "squared_mean"),
            CostTerm("control", base_speed, 2.0),
            CostTerm("off lane", off_lane, 1000.0, "share"),
            CostTerm("aside", lambda r: np.abs(r.object.pos[..., 0] - MIDDLE), 15.0),
            CostTerm("robot's end", lambda r: r.base.pos[..., 1] >= ROBOT_END, 1000.0, "share"),
            FALL,
        ),
        parameters=(
            Parameter("success_edge", 0.01, "m", (0.0, CASTORS)),
            Parameter("success_drop", 0.05, "m", (0.0, HEIGHT)),
            Parameter("success_speed", SUCCESS_SPEED, "m/s", (0.0, 1.0)),
            Parameter("success_tilt", SUCCESS_TILT, "rad", (0.0, np.pi / 4)),
        ),
        reset=Reset(
            near((2.0, -0.7), 2.0, 0.0),
            (OnFloor("chair", near((2.0, 0.5), 0.3, 0.0), CHAIR.rest_z),),
            clearance=1.2,
        ),
        success=AllBelow(
            Measure("castors beyond the edge", beyond_edge, "success_edge"),
            Measure("chair below the platform", below_platform, "success_drop"),
            Measure("chair's speed", terms.speed("object"), "success_speed"),
            Measure("chair's tilt", Z_UP.tilt, "success_tilt"),
        ),
        success_hold=HOLD,
        failure={
            "tipped": tipped,
            "beside the ramp": beside_the_ramp,
            "on the incline": on_the_incline,
            **LEFT,
        },
        goal=GOAL,
        time_limit=60.0,
        description="Spot pushes a 16.6 kg chair up a ramp and leaves it on the platform",
    )
