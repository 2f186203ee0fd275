"""The families' first address, where task files look for them: see tasks.spot.families."""

from sumo_dist.tasks.spot.families import (
    AXLE_LEVEL,
    NEAR,
    Z_UP,
    Manipuland,
    Standing,
    anywhere,
    at_origin,
    move,
    near_origin,
    upright,
)

__all__ = [
    "AXLE_LEVEL",
    "NEAR",
    "Z_UP",
    "Manipuland",
    "Standing",
    "anywhere",
    "at_origin",
    "move",
    "near_origin",
    "upright",
]
