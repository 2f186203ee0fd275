"""Spot walks to a goal among obstacles, through a gap in a wall."""

from collections.abc import Callable, Iterator

import mujoco
import numpy as np

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.files import find_model, read_model
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT, STAND_HEIGHT, spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import Reset, near
from sumo_dist.tasks.spot.families import WORKSPACE
from sumo_dist.tasks.spot.terms import HOLD, base_speed
from sumo_dist.tasks.success import AllBelow, Measure
from sumo_dist.tasks.task import Goal, Task
from sumo_dist.tasks.terms import FALL_WEIGHT, Residual

COURSE = SceneObject("course", "fixtures/course.xml")
OUTLINE = (-0.36, 0.0, 0.36)  # along the base, centres of circles that cover body and legs [m]
GIRTH = 0.32  # their radius [m]
JAW_GIRTH = 0.1  # radius of a circle around the gripper [m]

Prism = Callable[[np.ndarray], np.ndarray]
"""Points (B, T, 2) [m] -> distances from something's sides (B, T) [m], < 0 inside."""


def box(centre: np.ndarray, half: np.ndarray) -> Prism:
    """Return the distance from a box that stands square to the world."""

    def distance(points: np.ndarray) -> np.ndarray:
        off = np.abs(points - centre) - half
        return norm(np.maximum(off, 0.0)) + np.minimum(off.max(axis=-1), 0.0)

    return distance


def post(centre: np.ndarray, radius: float) -> Prism:
    """Return the distance from an upright cylinder."""
    return lambda points: norm(points - centre) - radius


def prisms(mjcf: str) -> Iterator[Prism]:
    """Read the sides of what can be touched in a fixture: boxes, square to the world, and posts."""
    model = read_model(find_model(mjcf), mjcf).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for i in np.flatnonzero(model.geom_contype):
        centre, size = data.geom_xpos[i, :2].copy(), model.geom_size[i].copy()
        if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_BOX:
            yield box(centre, size[:2])
        else:
            yield post(centre, size[0])


def clearance(obstacles: tuple[Prism, ...]) -> Residual:
    """Distance between the robot's outline and the nearest obstacle [m], < 0 at a collision."""

    def gap(r: View) -> np.ndarray:
        spots = [(r.base.pos + s * r.base.x, GIRTH) for s in OUTLINE]
        spots.append((r.gripper.pos, JAW_GIRTH))
        gaps = [away(pos[..., :2]) - girth for pos, girth in spots for away in obstacles]
        return np.minimum.reduce(gaps)

    return gap


def navigate() -> Task:
    """Spot walks to a goal behind a wall, whose gap is off the straight way, and round a crate.

    Cost (released code): 60 ||p_torso - p_goal|| + 2500 if it falls. Ours are the obstacles, which
    its free floor has not: 500 times the share of the rollout at which the robot's outline is in
    one; and 2 ||a||, so that it comes to rest at the goal. The distance is the straight one, and
    plans have to find the gap: with the usual 1.5 s the robot stays before the wall, since the way
    to the gap leads away from the goal. Hence plans of 3 s, with smooth noise, which keeps to a
    direction, and fewer of them, so that planning is about as dear as for other tasks. Only the
    base is planned for; the arm stays as in the stance, not stowed. Success is a robot at rest
    within 0.25 m; released it may walk past, at 0.5 m.
    """
    gap = clearance(tuple(prisms(COURSE.mjcf)))

    def touches(r: View) -> np.ndarray:
        return gap(r) < 0.0

    return Task(
        name="spot/navigate",
        scene=Scene(SPOT, fixtures=(COURSE,)),
        actions=spot_actions(arm=False),
        frames={"gripper": FrameRef("site", "site_arm_link_fngr")},
        cost=(
            CostTerm("goal", terms.goal_distance("base", STAND_HEIGHT), 60.0),
            CostTerm("collision", touches, 500.0, "share"),
            CostTerm("control", base_speed, 2.0),
            CostTerm("fall", terms.lies(SPOT), FALL_WEIGHT, "any"),
        ),
        parameters=(
            Parameter("goal", (2.0, 0.0), "m", (-WORKSPACE, WORKSPACE)),
            Parameter("success_radius", 0.25, "m", (0.0, 1.0)),
            Parameter("success_speed", 0.1, "m/s", (0.0, 1.0)),
        ),
        reset=Reset(near((-2.2, 0.0), 0.4, 0.5)),
        success=AllBelow(
            Measure("base to goal", terms.goal_distance("base"), "success_radius"),
            Measure("base's speed", terms.speed("base"), "success_speed"),
        ),
        success_hold=HOLD,
        failure={
            "at an obstacle": touches,
            "left the workspace": terms.outside(WORKSPACE, "base"),
        },
        goal=Goal("base", STAND_HEIGHT),
        trails=("base",),
        planner={"horizon": 3.0, "rollouts": 13, "noise_exponent": 2.0, "base_noise": 1.0},
        description="Spot walks to a goal behind a wall, through its gap and past a crate",
    )
