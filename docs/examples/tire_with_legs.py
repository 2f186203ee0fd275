"""spot/demo_tire_upright with the front legs, too, which the paper enables."""

from dataclasses import replace

from sumo_dist.tasks.spot.demos.tire import tire_upright
from sumo_dist.tasks.task import Task


def task() -> Task:
    """Return the task under a name of its own."""
    return replace(tire_upright(legs=True), name="spot/tire_with_legs")
