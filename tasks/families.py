"""Families of tasks: the same cost for any object (paper, section on the analysis tasks)."""

from dataclasses import dataclass

import numpy as np

from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.rollout.interface import FrameRef
from sumo_dist.tasks.reset import Start, redraw
from sumo_dist.tasks.task import Task

CLEARANCE = 1.0  # robot to object at the start, centre to centre, so that both start free [m]
SUCCESS_RADIUS = 0.1  # paper: object to goal [m]
SUCCESS_SPEED = 0.05  # paper: object's speed [m/s]


@dataclass(frozen=True)
class MoveReset:
    """Where robot and object start a move.

    Attributes:
        object: the object's body.
        rest_z: height of its origin at rest [m].
        goal: object position [m].
        robot_spread: standard deviation of the robot's xy [m].
        object_spread: standard deviation added to the object's annulus draw [m].
    """

    object: str
    rest_z: float
    goal: tuple[float, float, float]
    robot_spread: float = 1.0
    object_spread: float = 1.0

    def __call__(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        """Draw until robot and object stand clear of each other and the task is not yet solved."""
        return redraw(lambda: self._draw(rng, start), lambda state: self._accept(state, start))

    def _draw(self, rng: np.random.Generator, start: Start) -> np.ndarray:
        robot_xy = rng.normal(0.0, self.robot_spread, 2)
        angle, radius = rng.uniform(0.0, 2 * np.pi), rng.uniform(1.0, 2.0)
        object_xy = radius * np.array([np.cos(angle), np.sin(angle)])
        object_xy += rng.normal(0.0, self.object_spread, 2)
        pose = np.array([*object_xy, self.rest_z]), np.array([1.0, 0.0, 0.0, 0.0])
        return start.place(robot_xy, 0.0, {self.object: pose})

    def _accept(self, state: np.ndarray, start: Start) -> bool:
        base, thing = (state[start.index.pose(b)][:2] for b in (start.base, self.object))
        apart = np.linalg.norm(base - thing) > CLEARANCE
        unsolved = np.linalg.norm(thing - self.goal[:2]) > 5 * SUCCESS_RADIUS
        return bool(apart and unsolved) and not start.touching(state, self.object)


def move(
    name: str, mjcf: str, rest_z: float, aim: FrameRef, robot_spread: float, object_spread: float
) -> Task:
    """Spot moves an object to the origin with base and arm.

    Cost (paper): 60 ||p_obj - p_goal|| + 4 ||p_grip - p_obj|| + 20 ||v_obj||, averaged over the
    rollout. The velocity term is the square of the mean speed, as released: the linear form makes
    the robot timid (docs/decisions/0003).

    Args:
        name: the object's name; its root body has the same.
        mjcf: its model, below assets/ or an absolute path.
        rest_z: height of its origin when it rests on the floor [m].
        aim: the point of the object that the gripper is drawn to.
        robot_spread, object_spread: see MoveReset.
    """
    goal = (0.0, 0.0, rest_z)

    def to_goal(r: View) -> np.ndarray:
        return norm(r.object.pos - np.array(goal))

    def speed(r: View) -> np.ndarray:
        return norm(r.object.linvel)

    def to_gripper(r: View) -> np.ndarray:
        return norm(r.gripper.pos - r.aim.pos)

    def solved(r: View) -> np.ndarray:
        return (to_goal(r) < SUCCESS_RADIUS) & (speed(r) < SUCCESS_SPEED)

    return Task(
        name=f"spot/move_{name}",
        scene=Scene(SPOT, (SceneObject(name, mjcf),)),
        actions=spot_actions(),
        frames={
            "base": FrameRef("body", SPOT.base),
            "gripper": FrameRef("site", "site_arm_link_fngr"),
            "object": FrameRef("body", name),
            "aim": aim,
        },
        cost=(
            CostTerm("goal", to_goal, 60.0),
            CostTerm("gripper", to_gripper, 4.0),
            CostTerm("velocity", speed, 20.0, "squared_mean"),
        ),
        reset=MoveReset(name, rest_z, goal, robot_spread, object_spread),
        success=solved,
        goal=goal,
    )
