"""Where the candidates of a plan are put: how much of the noise each of them has."""

from typing import Literal

import numpy as np

Placement = Literal["alike", "near", "mixed"]

NEAR = 1.0 / 3.0  # of the noise, for a candidate that is close to the mean


def noise_shares(placement: Placement, rollouts: int, base: np.ndarray) -> np.ndarray:
    """Factors (B, n) on the noise of candidates 0 to B - 1; a candidate's depend on its row alone.

    Args:
        placement: "alike" leaves all their noise; "near" gives every second one a third of it;
            "mixed" does that, too, and of every eight candidates two move the base alone and two
            all but the base. Actions that are all of one kind have no such two parts.
        rollouts: B.
        base: (n,) True where an action is a velocity of the base.
    """
    shares = np.ones((rollouts, len(base)))
    if placement == "alike":
        return shares
    shares[2::2] = NEAR
    if placement == "mixed" and base.any() and not base.all():
        group = (np.arange(rollouts) - 1) // 2 % 4  # pairs of one with all its noise and one near
        shares[group == 0] *= base
        shares[group == 1] *= ~base
    return shares
