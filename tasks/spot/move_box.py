"""Spot pushes a 1.5 kg box of half a metre to the origin."""

from sumo_dist.rollout.interface import FrameRef
from sumo_dist.tasks.families import move
from sumo_dist.tasks.task import Task


def task() -> Task:
    """Return the task."""
    return move(
        name="box",
        mjcf="objects/box.xml",
        rest_z=0.254,
        aim=FrameRef("body", "box"),
        robot_spread=1.0,
        object_spread=1.0,
    )
