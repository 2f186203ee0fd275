"""Where the candidates of a plan are put: how much of the noise each of them has."""

from typing import Literal

import numpy as np

Placement = Literal["alike", "near"]

NEAR = 1.0 / 3.0  # of the noise, for a candidate that is close to the mean


def noise_shares(placement: Placement, rollouts: int) -> np.ndarray:
    """Factors (B,) on the noise of candidates 0 to B - 1; a candidate's depends on its row alone.

    "alike" leaves all their noise; "near" gives every second one a third of it.
    """
    shares = np.ones(rollouts)
    if placement == "near":
        shares[2::2] = NEAR
    return shares
