"""Families of tasks: the same cost for any object (paper, section on the analysis tasks)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sumo_dist.costs.fields import checked_number
from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import Dropped, FloorDraw, OnFloor, Reset, Ring
from sumo_dist.tasks.success import AllBelow, Measure
from sumo_dist.tasks.task import Goal, Task
from sumo_dist.tasks.terms import FALL_WEIGHT, TIPPED, Predicate

SUCCESS_RADIUS = 0.1  # paper: object to goal [m]
SUCCESS_SPEED = 0.05  # paper: object's speed [m/s]
SUCCESS_TILT = 0.1  # paper: from upright [rad]
SUCCESS_SPIN = 0.05  # paper: object's angular speed [rad/s]
WORKSPACE = 8.0  # what is farther from the origin cannot be fetched within an episode [m]
CLEARANCE = 1.0  # robot to object at the start of a move, centre to centre [m]
AWAY = 0.5  # object to goal at the start of a move, so that none starts nearly solved [m]
NEAR = Ring(inner=1.0, outer=2.0, spread=0.1)  # where objects start unless a task says otherwise
LEFT: dict[str, Predicate] = {"left the workspace": terms.outside(WORKSPACE, "object", "base")}


@dataclass(frozen=True)
class Standing:
    """What it means that an object stands.

    Attributes:
        off: View -> (B, T), how far it is from upright, from 0 on; the cost of the paper.
        at: tilt [rad] -> the value of `off` at that tilt.
        tilt: View -> (B, T), the tilt at which it is [rad].
    """

    off: Callable[[View], np.ndarray]
    at: Callable[[float], float]
    tilt: Callable[[View], np.ndarray]


Z_UP = Standing(
    off=lambda r: 1.0 - r.object.z[..., 2],
    at=lambda tilt: float(1.0 - np.cos(tilt)),
    tilt=lambda r: np.arccos(np.clip(r.object.z[..., 2], -1.0, 1.0)),
)
AXLE_LEVEL = Standing(
    off=lambda r: np.abs(r.object.y[..., 2]),
    at=lambda tilt: float(np.sin(tilt)),
    tilt=lambda r: np.arcsin(np.clip(np.abs(r.object.y[..., 2]), 0.0, 1.0)),
)


@dataclass(frozen=True)
class Manipuland:
    """An object that the robot is to move or set upright.

    Attributes:
        name: of the object; its root body has the same.
        mjcf: its model: below assets/, beside the file of the task, or an absolute path.
        rest_z: height of its origin when it stands on the floor [m].
        aim: the point that the gripper is drawn to; the body's origin by default.
        standing: what it means that it stands.
        rolls: set in motion, it may go on by itself.
        any_side: it is as good on its side as upright when it is moved.
    """

    name: str
    mjcf: str
    rest_z: float
    aim: FrameRef | None = None
    standing: Standing = Z_UP
    rolls: bool = False
    any_side: bool = False

    def __post_init__(self) -> None:
        checked_number(f"rest_z of object {self.name!r}", self.rest_z)

    @property
    def scene(self) -> Scene:
        """Spot and this object."""
        return Scene(SPOT, (SceneObject(self.name, self.mjcf),))

    @property
    def frames(self) -> dict[str, FrameRef]:
        """The frames that both families' residuals see."""
        body = FrameRef("body", self.name)
        return {
            "gripper": FrameRef("site", "site_arm_link_fngr"),
            "object": body,
            "aim": self.aim or body,
        }


def anywhere(rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Draw the robot's xy from N(0, I) [m], yaw 0."""
    return rng.normal(0.0, 1.0, 2), 0.0


def near_origin(rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Draw the robot's xy within 0.5 m of the origin on both axes, in any heading."""
    return rng.uniform(-0.5, 0.5, 2), rng.uniform(0.0, 2 * np.pi)


def at_origin(_rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Place the robot at the origin, yaw 0."""
    return np.zeros(2), 0.0


UPRIGHT = (
    Parameter("success_tilt", SUCCESS_TILT, "rad", (0.0, np.pi / 4)),
    Parameter("success_spin", SUCCESS_SPIN, "rad/s", (0.0, 1.0)),
)


def upright_test(standing: Standing) -> AllBelow:
    """Return the test of an upright object at rest, by the parameters `UPRIGHT` (paper)."""
    return AllBelow(
        Measure("object's tilt", standing.tilt, "success_tilt"),
        Measure("object's spin", terms.spin("object"), "success_spin"),
    )


def move(thing: Manipuland, robot: FloorDraw = near_origin, ring: FloorDraw = NEAR) -> Task:
    """Spot moves an object to its goal with base and arm; the goal is the origin by default.

    Cost (paper): 60 ||p_obj - p_goal|| + 4 ||p_grip - p_obj|| + 20 ||v_obj||, averaged over the
    rollout, and 2500 if the robot falls. The velocity term is the square of the mean speed, as
    released: the linear form makes the robot timid (docs/decisions/0003). Ours is the term of an
    object that has tipped: 50 times the share of the rollout for which it has, so that setting it
    up again pays (docs/decisions/0006).

    Args:
        thing: the object.
        robot: draws where the robot starts.
        ring: draws where the object starts.
    """
    to_goal, speed = terms.goal_distance("object", thing.rest_z), terms.speed("object")

    def tipped(r: View) -> np.ndarray:
        return thing.standing.off(r) > thing.standing.at(TIPPED)

    def near_goal(r: View) -> np.ndarray:
        return terms.goal_distance("object")(r) <= AWAY

    may_tip = not thing.any_side
    failure: dict[str, Predicate] = {"tipped": tipped} if may_tip else {}
    return Task(
        name=f"spot/move_{thing.name}",
        scene=thing.scene,
        actions=spot_actions(),
        frames=thing.frames,
        cost=(
            CostTerm("goal", to_goal, 60.0),
            CostTerm("gripper", terms.distance("gripper", "aim"), 4.0),
            CostTerm("velocity", speed, 20.0, "squared_mean"),
            *((CostTerm("tipped", tipped, 50.0, "share"),) if may_tip else ()),
            CostTerm("fall", terms.lies(SPOT), FALL_WEIGHT, "any"),
        ),
        parameters=(
            Parameter("goal", (0.0, 0.0), "m", (-WORKSPACE, WORKSPACE)),
            Parameter("success_radius", SUCCESS_RADIUS, "m", (0.0, 1.0)),
            Parameter("success_speed", SUCCESS_SPEED, "m/s", (0.0, 1.0)),
        ),
        reset=Reset(robot, (OnFloor(thing.name, ring, thing.rest_z),), CLEARANCE, near_goal),
        success=AllBelow(
            Measure("object to goal", to_goal, "success_radius"),
            Measure("object's speed", speed, "success_speed"),
        ),
        success_hold=0.5 if thing.rolls else 0.0,
        failure={**failure, **LEFT},
        goal=Goal("object", thing.rest_z),
        description=f"Spot pushes the {thing.name} to its goal and leaves it at rest",
    )


def upright(thing: Manipuland, robot: FloorDraw = at_origin, ring: FloorDraw = NEAR) -> Task:
    """Spot sets an object upright with base and arm, wherever it ends up standing.

    Cost (paper): 100 (1 - z_obj . z) + 0.5 ||p_grip - p_obj||, averaged over the rollout, and 2500
    if the robot falls; of the tire, which may stand on any part of its tread, the first term is
    100 |y_tire . z|.

    Args:
        thing: the object.
        robot: draws where the robot starts.
        ring: draws the place above which the object is dropped before the start.
    """
    solved = upright_test(thing.standing)
    return Task(
        name=f"spot/upright_{thing.name}",
        scene=thing.scene,
        actions=spot_actions(),
        frames=thing.frames,
        cost=(
            CostTerm("upright", thing.standing.off, 100.0),
            CostTerm("gripper", terms.distance("gripper", "aim"), 0.5),
            CostTerm("fall", terms.lies(SPOT), FALL_WEIGHT, "any"),
        ),
        parameters=UPRIGHT,
        reset=Reset(robot, (Dropped(thing.name, ring),), solved=solved),
        success=solved,
        failure=LEFT,
        description=f"Spot sets the {thing.name}, dropped in a random attitude, upright",
    )
