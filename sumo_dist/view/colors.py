"""The palette of the 3D view, and cost as colour."""

import numpy as np

Color = tuple[int, int, int]

GOAL: Color = (64, 224, 140)
BASE_TRAIL: Color = (96, 190, 255)
OBJECT_TRAIL: Color = (255, 138, 60)
ELITE: Color = (255, 255, 255)
GROUND: Color = (66, 72, 83)
SERIES: tuple[Color, ...] = (  # of plots; Okabe and Ito's set, for all kinds of sight
    (86, 180, 233),
    (240, 228, 66),
    (0, 158, 115),
    (230, 159, 0),
    (204, 121, 167),
    (213, 94, 0),
    (0, 114, 178),
    (170, 170, 170),
)

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


def cost_colors(costs: np.ndarray) -> np.ndarray:
    """Colour costs by rank: the best is bright yellow, the worst dark violet.

    Ranks, not values: one diverged candidate must not push all others into one colour.

    Args:
        costs: (B,) finite.

    Returns:
        (B, 3) uint8.
    """
    ranks = np.argsort(np.argsort(costs, kind="stable"), kind="stable")
    goodness = 1.0 - ranks / max(len(costs) - 1, 1)
    at = goodness * (len(_VIRIDIS) - 1)
    steps = np.arange(len(_VIRIDIS))
    channels = [np.interp(at, steps, _VIRIDIS[:, i]) for i in range(3)]
    return np.stack(channels, axis=1).round().astype(np.uint8)
