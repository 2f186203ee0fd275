"""The paper's ten analysis tasks: Spot moves, and sets upright, each of five objects."""

from collections.abc import Callable
from functools import partial

import numpy as np

from sumo_dist.model.frames import FrameRef
from sumo_dist.tasks.reset import Ring
from sumo_dist.tasks.spot.families import AXLE_LEVEL, Manipuland, anywhere, move, upright
from sumo_dist.tasks.task import Task

BOX = Manipuland("box", "objects/box.xml", rest_z=0.254, any_side=True)
CHAIR = Manipuland(
    "chair", "objects/chair.xml", rest_z=0.010, aim=FrameRef("site", "chair/site_object")
)
CONE = Manipuland(
    "cone", "objects/cone.xml", rest_z=0.002, aim=FrameRef("site", "cone/site_object")
)
TIRE = Manipuland("tire", "objects/tire.xml", rest_z=0.33, standing=AXLE_LEVEL, rolls=True)
RACK = Manipuland("rack", "objects/rack.xml", rest_z=0.3)

FAR = Ring(inner=1.0, outer=2.0, spread=1.0)
BEFORE_THE_ROBOT = Ring(inner=0.2, outer=0.5, spread=0.1)


def behind_origin(rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Place the robot 1.5 m behind the origin, give or take 1 mm, and facing it."""
    return np.array([-1.5, 0.0]) + rng.normal(0.0, 0.001, 2), 0.0


ANALYSIS: dict[str, Callable[[], Task]] = {
    "spot/move_box": partial(move, BOX, anywhere, FAR),
    "spot/move_chair": partial(move, CHAIR, anywhere, FAR),
    "spot/move_cone": partial(move, CONE),
    "spot/move_tire": partial(move, TIRE),
    "spot/move_rack": partial(move, RACK),
    "spot/upright_box": partial(upright, BOX),
    "spot/upright_chair": partial(upright, CHAIR),
    "spot/upright_cone": partial(upright, CONE, behind_origin, BEFORE_THE_ROBOT),
    "spot/upright_tire": partial(upright, TIRE),
    "spot/upright_rack": partial(upright, RACK),
}
