"""What is drawn into the scene, in Rerun and in films: colours, goal rings, candidates in order."""

import numpy as np

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.tasks.task import Task

Color = tuple[int, int, int]

ELITE: Color = (255, 255, 255)
GOAL: Color = (64, 224, 140)
LIMB: Color = (255, 214, 102)
GHOST: Color = (170, 200, 255)
RECORDED: Color = (255, 120, 110)  # of a recorded future beside the one that is shown
_ROBOT: Color = (96, 190, 255)
_OBJECTS: tuple[Color, ...] = ((255, 138, 60), (222, 184, 96), (226, 110, 140), (176, 150, 230))
ON_FLOOR = 0.012  # height of what is drawn on the floor, so that it is not hidden [m]

_LINES: tuple[Color, ...] = (  # legible on dark and on light
    (66, 146, 214),
    (238, 130, 50),
    (44, 160, 112),
    (204, 96, 160),
    (148, 118, 200),
    (200, 160, 40),
    (214, 70, 70),
    (130, 130, 130),
)

_AZIMUTH = -55.0  # [deg]
SHOWN = 32  # candidates at most, of all ranks, besides the elites
TRACE_POINTS = 13  # of a shown candidate's path; elites have all
_RING_RADII = (0.1, 0.25, 0.4)  # [m]

# Viridis at equal steps: perceptually uniform, legible in grey and to the colour-blind.
_VIRIDIS = np.array(
    [
        (68, 1, 84),
        (72, 40, 120),
        (62, 74, 137),
        (49, 104, 142),
        (38, 130, 142),
        (31, 158, 137),
        (53, 183, 121),
        (109, 205, 89),
        (180, 222, 44),
        (253, 231, 37),
    ],
    float,
)


def line_color(i: int) -> Color:
    """Colour of a plot's or chart's line number i."""
    return _LINES[i % len(_LINES)]


def way_colors(task: Task) -> dict[str, Color]:
    """Frames whose way over the floor is drawn, the robot's first, and its colour."""
    objects = {name: _OBJECTS[i % len(_OBJECTS)] for i, name in enumerate(task.movers)}
    return {"base": _ROBOT, **objects}


def goal_rings(goal: np.ndarray) -> np.ndarray:
    """Return closed lines around the foot of a goal (3,), (rings, P, 3), world [m]."""
    angles = np.linspace(0.0, 2 * np.pi, 49)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    foot = np.array([goal[0], goal[1], ON_FLOOR])
    return foot + np.array(_RING_RADII)[:, None, None] * circle


def eye_azimuth(robot: np.ndarray, target: np.ndarray) -> float:
    """Return the direction from which a picture is taken, in the floor's plane [deg].

    It is _AZIMUTH, or the opposite if the robot is on the far side from there: an object that is
    pushed towards the eye, or a door, would hide it.

    Args:
        robot: (3,) where the robot is at the start, world [m].
        target: (3,) what the eye looks at.
    """
    away, angle = robot[:2] - target[:2], np.deg2rad(_AZIMUTH)
    nearer = away @ [np.cos(angle), np.sin(angle)]  # how much nearer the robot is [m]
    return _AZIMUTH + 180.0 if nearer < -0.5 * np.linalg.norm(away) else _AZIMUTH


def elite_count(planner: PlannerConfig) -> int:
    """Return how many of the best are drawn apart."""
    return 1 if planner.optimizer == "ps" else planner.elites


def ranked(costs: np.ndarray, planner: PlannerConfig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rank a plan's candidates.

    Colours go by rank, not by value: one that went wrong must not push all others into one colour.

    Args:
        costs: (B,) +inf where there is nothing to draw.
        planner: its settings decide how many are elites.

    Returns:
        Indices of the elites, best first; indices of the others, worst first, so that the better
        are drawn over the worse; and the others' colours, (others, 3) uint8, from bright yellow
        (cheap) to dark violet.
    """
    order = np.argsort(costs, kind="stable")
    order = order[np.isfinite(costs[order])]
    count = elite_count(planner)
    at = np.linspace(len(_VIRIDIS) - 1, 0, len(order))[count:][::-1]
    steps = np.arange(len(_VIRIDIS))
    channels = [np.interp(at, steps, channel) for channel in _VIRIDIS.T]
    return order[:count], order[count:][::-1], np.stack(channels, axis=1).round().astype(np.uint8)


def thinned(count: int, most: int) -> np.ndarray:
    """Return indices, evenly spread, of at most so many of a number of things."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(int)
