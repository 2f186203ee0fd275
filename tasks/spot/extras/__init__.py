"""Spot's tasks in the paper's release beside those of the paper: a ramp, a tire, a walk."""

from collections.abc import Callable

from sumo_dist.tasks.spot.extras.navigate import navigate
from sumo_dist.tasks.spot.extras.ramp import chair_ramp
from sumo_dist.tasks.spot.extras.roll import tire_roll
from sumo_dist.tasks.task import Task

EXTRAS: dict[str, Callable[[], Task]] = {
    "spot/chair_ramp": chair_ramp,
    "spot/tire_roll": tire_roll,
    "spot/navigate": navigate,
}
