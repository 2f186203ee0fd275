"""What is dragged or pushed: the family of demonstrations that end at a goal on the floor."""

from collections.abc import Mapping

from sumo_dist.costs.terms import CostTerm
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import FloorDraw, OnFloor, Reset
from sumo_dist.tasks.spot.families import LEFT, Z_UP
from sumo_dist.tasks.spot.terms import DELIVERY, FRAMES, HOLD, delivery_test
from sumo_dist.tasks.task import Goal, Task

NOTHING: Mapping[str, float] = {}


def deliver(
    name: str,
    scene: Scene,
    rest_z: float,
    *,
    description: str,
    actions: ActionSpace,
    cost: tuple[CostTerm, ...],
    robot: FloorDraw,
    where: FloorDraw,
    frames: Mapping[str, FrameRef],
    time_limit: float = 30.0,
    planner: Mapping[str, float] = NOTHING,
) -> Task:
    """Spot brings the one object of a scene to its goal, where it has to stand at rest.

    Args:
        name: of the task.
        scene: robot and object.
        rest_z: height of the object's origin when it stands [m].
        description: of the task.
        actions: that are searched.
        cost: its terms; they see the object as `object`.
        robot: draws where the robot starts.
        where: draws where the object starts.
        frames: beside those of gripper, wrist and object.
        time_limit: [s].
        planner: settings that it needs.
    """
    (thing,) = scene.objects
    return Task(
        name=name,
        scene=scene,
        actions=actions,
        frames={**FRAMES, "object": FrameRef("body", thing.name), **frames},
        cost=cost,
        parameters=DELIVERY,
        reset=Reset(robot, (OnFloor(thing.name, where, rest_z),)),
        success=delivery_test(Z_UP),
        success_hold=HOLD,
        failure={"tipped": terms.tipped("object"), **LEFT},
        goal=Goal("object", rest_z),
        time_limit=time_limit,
        planner=planner,
        description=description,
    )
