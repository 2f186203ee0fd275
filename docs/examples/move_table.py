"""Spot brings G1's table to its goal: an object that no policy of ours was ever trained with."""

from sumo_dist.tasks.spot.families import Manipuland, move
from sumo_dist.tasks.task import Task


def task() -> Task:
    """Return the task."""
    return move(Manipuland("table", "objects/table.xml", rest_z=0.0))
