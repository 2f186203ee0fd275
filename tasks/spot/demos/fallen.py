"""Spot sets a fallen cone and a fallen chair upright (paper, appendix)."""

import numpy as np

from sumo_dist.costs.terms import CostTerm
from sumo_dist.robots.spot import spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import Dropped, FloorDraw, Reset, Ring
from sumo_dist.tasks.spot.analysis import CHAIR, CONE, FAR, behind_origin
from sumo_dist.tasks.spot.families import LEFT, UPRIGHT, Manipuland, anywhere, upright_test
from sumo_dist.tasks.spot.terms import (
    FALL,
    FRAMES,
    HOLD,
    LOW,
    base_speed,
    lying,
    not_fallen,
    squared_speed,
)
from sumo_dist.tasks.task import Task
from sumo_dist.tasks.terms import Residual

ON_ITS_SIDES = (
    (np.pi / 2, 0.0, 0.0),
    (-np.pi / 2, 0.0, 0.0),
    (0.0, np.pi / 2, 0.0),
    (0.0, -np.pi / 2, 0.0),
)


def standoff(reach: float) -> Residual:
    """Distance of the base from the object, no more than a reach [m]."""
    away = terms.distance("base", "object")
    return lambda r: np.minimum(reach, away(r))


def set_upright(
    thing: Manipuland, robot: FloorDraw, where: FloorDraw, time_limit: float, slope: float = 0.0
) -> Task:
    """Spot sets an object upright that lies on one of its sides.

    Cost (paper): w_orient (1 - exp(5 (z_obj . z - 1))) + 8 ||p_grip - p_obj|| - 50 min(1, ||p_torso
    - p_obj||) + 64 ||v_obj||^2 + 2 ||a||; weights, sharpness and reach, which it leaves out, are
    those of the code at the time, whose sum over 100 steps makes w_orient 5000 against means.

    Args:
        thing: the object.
        robot: draws where the robot starts.
        where: draws the place above which the object is dropped.
        time_limit: robot time [s].
        slope: weight of 1 - z_obj . z, which has a slope upside down, where the exponential has
            none.
    """
    straight = (CostTerm("upright", thing.standing.off, slope),) if slope else ()
    return Task(
        name=f"spot/demo_{thing.name}_upright",
        scene=thing.scene,
        actions=spot_actions(),
        frames={**FRAMES, **thing.frames},
        cost=(
            CostTerm("lying", lying(5.0), 5000.0),
            *straight,
            CostTerm("gripper", terms.distance("gripper", "aim"), 8.0),
            CostTerm("standoff", standoff(1.0), -50.0),
            CostTerm("velocity", squared_speed("object"), 64.0),
            CostTerm("control", base_speed, 2.0),
            LOW,
            FALL,
        ),
        parameters=UPRIGHT,
        reset=Reset(
            robot,
            (Dropped(thing.name, where, ON_ITS_SIDES),),
            solved=not_fallen(thing.standing),
        ),
        success=upright_test(thing.standing),
        success_hold=HOLD,
        failure=LEFT,
        time_limit=time_limit,
        description=f"Spot sets the {thing.name}, which has fallen over, upright",
    )


def cone_upright() -> Task:
    """See `set_upright`."""
    return set_upright(CONE, behind_origin, Ring(0.2, 0.5, 1.0), 30.0)


def chair_upright() -> Task:
    """See `set_upright`."""
    return set_upright(CHAIR, anywhere, FAR, 60.0, slope=1000.0)
