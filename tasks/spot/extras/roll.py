"""Spot rolls a standing tire to its goal without laying it over (released code)."""

from dataclasses import replace

import numpy as np

from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.robots.spot import SPOT, spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import OnFloor, Reset, anywhere_within
from sumo_dist.tasks.spot.analysis import TIRE
from sumo_dist.tasks.spot.families import AXLE_LEVEL, CLEARANCE, LEFT, at_origin
from sumo_dist.tasks.spot.terms import DELIVERY, HOLD, OPEN_JAW, delivery_test
from sumo_dist.tasks.task import Goal, Task
from sumo_dist.tasks.terms import TIPPED

LEAN = 0.1  # sine of the lean from which it counts
BEHIND = 1.0  # of the torso from the tire, on the far side of its goal [m]
NEAR = 0.3  # of the tire from its goal: a tire's radius, nearly [m]
UNDER, LOW = 0.15, 0.05  # the gripper's place: behind the tire's centre, and its height [m]


def way(r: View) -> np.ndarray:
    """Direction from the tire to its goal, (B, T, 3); shorter than 1 in the last centimetres."""
    to = np.array([*r.p.goal, TIRE.rest_z]) - r.object.pos
    return to / (0.01 + norm(to))[..., None]


def behind(r: View) -> np.ndarray:
    """Distance of the base from its place behind the tire, (B, T) [m]."""
    return norm(r.base.pos - (r.object.pos - BEHIND * way(r)))


def under(r: View) -> np.ndarray:
    """Distance of the gripper from its place behind the tire, low, (B, T) [m]."""
    off = r.gripper.pos - (r.object.pos - UNDER * way(r))
    return np.sqrt(norm(off[..., :2]) ** 2 + (r.gripper.pos[..., 2] - LOW) ** 2)


def tire_roll() -> Task:
    """Spot walks around a standing tire and rolls it to where it stood itself.

    Cost: the released code's terms and weights, but for the lean: it counts to both sides, where
    released it does to one, and as 500 times its share of the rollout, where 5000 are summed over
    100 steps: at that weight a tire that has lain down leaves nothing else to plan for. Success is
    a tire that stands at rest within 0.3 m; released it may roll past, at 0.5 m. At 0.2 m one in
    five stopped beside the goal, on its axle's side, to where it does not roll. The gripper is one
    action, open or closed, where the release has two.
    """
    return Task(
        name="spot/tire_roll",
        scene=TIRE.scene,
        actions=spot_actions(gripper=True).within("gripper", default=OPEN_JAW),
        frames=TIRE.frames,
        cost=(
            CostTerm("goal", terms.goal_distance("object", TIRE.rest_z), 60.0),
            CostTerm("torso", behind, 1.0),
            CostTerm("gripper", under, 1.0),
            CostTerm("velocity", terms.speed("object"), 10.0),
            CostTerm("spin", terms.spin("object"), 0.3),
            CostTerm("lean", lambda r: AXLE_LEVEL.off(r) > LEAN, 500.0, "share"),
            CostTerm("fall", terms.lies(SPOT), 5000.0, "any"),
        ),
        parameters=tuple(
            replace(p, default=NEAR) if p.name == "success_radius" else p for p in DELIVERY
        ),
        reset=Reset(
            at_origin,
            (OnFloor("tire", anywhere_within(1.5), TIRE.rest_z),),
            CLEARANCE,
            lambda r: terms.goal_distance("object")(r) <= r.p.success_radius,
        ),
        success=delivery_test(AXLE_LEVEL),
        success_hold=HOLD,
        failure={"tipped": lambda r: AXLE_LEVEL.off(r) > AXLE_LEVEL.at(TIPPED), **LEFT},
        goal=Goal("object", TIRE.rest_z),
        description="Spot rolls a 15 kg tire, which stands, to its goal",
    )
