"""Spot sets a lying tire upright, and lays a tire upon another (paper, appendix)."""

import numpy as np

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm, norm
from sumo_dist.costs.view import View
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT, STAND_HEIGHT, spot_actions
from sumo_dist.tasks import terms
from sumo_dist.tasks.reset import Dropped, OnFloor, Reset, anywhere_within, near
from sumo_dist.tasks.spot.families import (
    AXLE_LEVEL,
    CLEARANCE,
    LEFT,
    SUCCESS_SPEED,
    UPRIGHT,
    WORKSPACE,
    upright_test,
)
from sumo_dist.tasks.spot.terms import (
    FALL,
    FRAMES,
    HOLD,
    LOW,
    base_speed,
    dot,
    not_fallen,
    once,
    spinning,
    stands,
    unit,
    until,
    within,
)
from sumo_dist.tasks.success import AllBelow, Measure
from sumo_dist.tasks.task import Task

TIRE = "objects/tire.xml"
FEET = {
    "left_foot": FrameRef("site", "site_front_left"),
    "right_foot": FrameRef("site", "site_front_right"),
}
RADIUS, WIDTH = 0.33, 0.26  # of the tire [m]
FLAT = ((np.pi / 2, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0))  # on the one side or the other
STANDOFF = 0.75  # of the torso from a tire that is set upright (released code) [m]
BESIDE = 0.8  # of the torso from a tire that is laid upon another (released code) [m]
AWAY = 0.1  # of the gripper from a tire that it has let go [m]
FARTHEST, NEAREST = 3 * RADIUS, RADIUS  # between tires: where the torso begins to go around, ends


def offset(r: View, frame: str, x: np.ndarray, y: np.ndarray, z: float) -> np.ndarray:
    """Distance of a frame from points of which x and y are (B, T) and z is one height [m]."""
    pos = r[frame].pos
    return np.sqrt((pos[..., 0] - x) ** 2 + (pos[..., 1] - y) ** 2 + (pos[..., 2] - z) ** 2)


def turned(vector: np.ndarray, angle: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y of vectors (B, T, 3), turned about the vertical [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    return cos * x - sin * y, sin * x + cos * y


def to_robot(r: View) -> np.ndarray:
    """Direction from the tire to the base, (B, T, 3)."""
    return unit(r.base.pos - r.object.pos)


def tread(r: View) -> np.ndarray:
    """Distance of the gripper from the tread on the robot's side, 0.1 m above the tire, (B, T)."""
    at = r.object.pos + (RADIUS - 0.05) * to_robot(r)
    return offset(r, "gripper", at[..., 0], at[..., 1], WIDTH / 2 + 0.1)


def foot(r: View) -> np.ndarray:
    """Distance of the nearer front foot from its place on the tread, 45 degrees aside, (B, T)."""
    away = []
    for frame, side in (("right_foot", 1.0), ("left_foot", -1.0)):
        x, y = turned(RADIUS * to_robot(r), side * np.pi / 4)
        away.append(offset(r, frame, r.object.pos[..., 0] + x, r.object.pos[..., 1] + y, 0.1))
    return np.minimum(*away)


def standoff(r: View) -> np.ndarray:
    """Distance of the base from a standing robot's place before the tire, (B, T) [m]."""
    at = r.object.pos + STANDOFF * to_robot(r)
    return offset(r, "base", at[..., 0], at[..., 1], STAND_HEIGHT)


def tire_upright() -> Task:
    """Spot sets a tire upright that lies on its side.

    Cost: the paper's terms with the released code's weights, without the release's two penalties on
    the gripper, which forbid the motion that works: hooking the tread from outside, low. It may
    pitch and lower its torso, too, which the paper has not.
    """
    up = stands(AXLE_LEVEL)
    return Task(
        name="spot/demo_tire_upright",
        scene=Scene(SPOT, (SceneObject("tire", TIRE),)),
        actions=spot_actions(torso=True, legs=True),
        frames={**FRAMES, **FEET, "object": FrameRef("body", "tire")},
        cost=(
            CostTerm("tilt", lambda r: np.exp(AXLE_LEVEL.off(r)), 200.0),
            CostTerm("gripper", until(up, tread), 10.0),
            CostTerm("foot", until(up, foot), 5.0),
            CostTerm("torso", until(up, standoff), 5.0),
            CostTerm("control", base_speed, 2.0),
            CostTerm("spin", once(up, spinning("object")), 50.0),
            CostTerm(
                "hands off", once(up, within(0.7, terms.distance("gripper", "object"))), 100.0
            ),
            LOW,
            FALL,
        ),
        parameters=UPRIGHT,
        reset=Reset(
            anywhere_within(2.0),
            (Dropped("tire", anywhere_within(2.0), FLAT),),
            CLEARANCE,
            not_fallen(AXLE_LEVEL),
        ),
        success=upright_test(AXLE_LEVEL),
        success_hold=HOLD,
        failure=LEFT,
        description="Spot sets a 15 kg tire, which lies on its side, upright",
    )


def apart(r: View) -> np.ndarray:
    """Distance of the tires on the floor, (B, T) [m]."""
    return norm((r.top.pos - r.bottom.pos)[..., :2])


def height(r: View) -> np.ndarray:
    """How far the upper tire is from lying upon the lower one, in height, (B, T) [m]."""
    return np.abs(r.top.pos[..., 2] - (r.bottom.pos[..., 2] + WIDTH))


def lean(r: View) -> np.ndarray:
    """1 - y_top . u with u from the upper to the lower tire; 0 in rollouts that stay 2 m away."""
    way = r.bottom.pos - r.top.pos
    close = (norm(way) < 2.0).any(axis=1, keepdims=True)
    return np.where(close, 1.0 - dot(r.top.y, unit(way)), 0.0)


def unrest(r: View) -> np.ndarray:
    """Speed and spin of the lower tire, (B, T) [m/s, rad/s]."""
    return norm(r.bottom.linvel) + norm(r.bottom.angvel)


def highest(r: View) -> np.ndarray:
    """Distance of the gripper from the highest point of the upper tire's tread, (B, T) [m]."""
    up = -r.top.y[..., 2:3] * r.top.y
    up = up + np.array([0.0, 0.0, 1.0])
    return norm(r.gripper.pos - (r.top.pos + RADIUS * unit(up)))


def beside(r: View) -> np.ndarray:
    """Distance of the base from its place beside the upper tire, (B, T) [m].

    It is behind it as seen from the lower one, and goes around it by up to 90 degrees as the two
    come together (released code).
    """
    way = r.top.pos - r.bottom.pos
    near = 1.0 - np.clip((norm(way) - NEAREST) / (FARTHEST - NEAREST), 0.0, 1.0)
    x, y = turned(BESIDE * unit(way), -np.deg2rad(25.0) - np.pi / 2 * near)
    return offset(r, "base", r.top.pos[..., 0] + x, r.top.pos[..., 1] + y, STAND_HEIGHT)


def too_high(r: View) -> np.ndarray:
    """How far the gripper is above a standing tire, (B, T) [m]."""
    return np.maximum(0.0, r.gripper.pos[..., 2] - 2 * RADIUS)


def too_near(r: View) -> np.ndarray:
    """How far the gripper is inside the 0.2 m around the upper tire, (B, T) [m]; outside < 0."""
    way = r.gripper.pos - r.top.pos
    along = dot(way, r.top.y)
    beyond_tread = np.maximum(0.0, norm(way - along[..., None] * r.top.y) - RADIUS)
    beyond_side = np.maximum(0.0, np.abs(along) - WIDTH / 2)
    return 2 * AWAY - np.sqrt(beyond_tread**2 + beyond_side**2)


def stacked(r: View) -> np.ndarray:
    """Whether the tires lie upon each other as success asks for, (B, T) bool."""
    return (apart(r) < r.p.success_apart) & (height(r) < r.p.success_height)


def tire_stack() -> Task:
    """Spot lays a standing tire upon one that lies.

    Cost: the paper's with its weights and the released code's penalty on a gripper above the tire.
    Ours: being done pays 80, more than staying clear costs, else the tire is parked at the edge of
    what counts as stacked.
    """
    off = once(stacked, within(0.6, terms.distance("gripper", "top")))
    return Task(
        name="spot/demo_tire_stack",
        scene=Scene(SPOT, (SceneObject("bottom", TIRE), SceneObject("top", TIRE))),
        actions=spot_actions(),
        frames={
            **FRAMES,
            "bottom": FrameRef("body", "bottom"),
            "top": FrameRef("body", "top"),
        },
        cost=(
            CostTerm("apart", apart, 100.0),
            CostTerm("height", height, 200.0),
            CostTerm("lean", lean, 20.0),
            CostTerm("bottom", unrest, 50.0),
            CostTerm("gripper", until(stacked, highest), 10.0),
            CostTerm("torso", until(stacked, beside), 10.0),
            CostTerm("too high", until(stacked, too_high), 1000.0),
            CostTerm("control", base_speed, 1.0),
            CostTerm("hands off", off, 100.0),
            CostTerm("done", stacked, -80.0, "share"),
            LOW,
            FALL,
        ),
        parameters=(
            Parameter("success_apart", 0.1, "m", (0.0, 0.5)),
            Parameter("success_height", 0.05, "m", (0.0, 0.5)),
            Parameter("success_speed", SUCCESS_SPEED, "m/s", (0.0, 1.0)),
            Parameter("success_nearness", AWAY, "m", (0.0, 2 * AWAY)),
        ),
        reset=Reset(
            near((-2.0, -2.0), 0.1, 0.1),
            (
                Dropped("bottom", near((-2.0, 1.0), 0.05, 0.1), FLAT[:1]),
                OnFloor("top", near((-2.0, 0.0), 0.05, 0.1), RADIUS),
            ),
        ),
        success=AllBelow(
            Measure("tires apart", apart, "success_apart"),
            Measure("upper tire's height", height, "success_height"),
            Measure("upper tire's speed", terms.speed("top"), "success_speed"),
            Measure("lower tire's speed", terms.speed("bottom"), "success_speed"),
            Measure("gripper too near", too_near, "success_nearness"),
        ),
        success_hold=HOLD,
        failure={"left the workspace": terms.outside(WORKSPACE, "top", "base")},
        trails=("gripper", "top"),
        description="Spot lays a 15 kg tire, which stands, upon one that lies",
    )
