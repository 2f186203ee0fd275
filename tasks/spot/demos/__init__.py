"""The paper's eight demonstrations with Spot: things larger or heavier than it can lift."""

from collections.abc import Callable

from sumo_dist.tasks.spot.demos.barrier import barrier_drag, barrier_upright
from sumo_dist.tasks.spot.demos.fallen import chair_upright, cone_upright
from sumo_dist.tasks.spot.demos.rack import rack_drag
from sumo_dist.tasks.spot.demos.rugged_box import box_push
from sumo_dist.tasks.spot.demos.tire import tire_stack, tire_upright
from sumo_dist.tasks.task import Task

DEMONSTRATIONS: dict[str, Callable[[], Task]] = {
    "spot/demo_tire_upright": tire_upright,
    "spot/demo_barrier_upright": barrier_upright,
    "spot/demo_cone_upright": cone_upright,
    "spot/demo_chair_upright": chair_upright,
    "spot/demo_tire_stack": tire_stack,
    "spot/demo_barrier_drag": barrier_drag,
    "spot/demo_rack_drag": rack_drag,
    "spot/demo_box_push": box_push,
}
