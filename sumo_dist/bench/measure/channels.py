"""How far estimated states are from the true ones, channel by channel."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_dist.math.rotations import conjugate, multiply, to_rotation_vector
from sumo_dist.model.index import StateIndex
from sumo_dist.robots.spot import SPOT


class Errors(NamedTuple):
    """Root mean square over time of each channel's error vector."""

    base_mm: float
    base_mrad: float
    base_m_s: float
    base_rad_s: float
    joints_mrad: float
    joints_rad_s: float
    box_mm: float
    box_mrad: float
    box_m_s: float
    box_rad_s: float


def errors_of(index: StateIndex, states: np.ndarray, estimates: np.ndarray) -> Errors:
    """Compare estimates (T, nq + nv) with the states they are of."""
    positions, velocities = index.joints(SPOT.joints)
    off = estimates - states
    joints = _rms(off[:, positions]) * 1e3, _rms(off[:, velocities])
    base, box = (_body_errors(index, body, states, estimates) for body in ("body", "box"))
    return Errors._make([*base, *joints, *box])


def mean_errors(errors: Sequence[Errors]) -> Errors:
    """Root mean square over walks; nan if there are none."""
    if not errors:
        return Errors._make([np.nan] * len(Errors._fields))
    return Errors._make(np.sqrt(np.square(np.array(errors)).mean(axis=0)).round(4).tolist())


def title(channel: str) -> str:
    """Head a column of errors, with its unit."""
    what, _, unit = channel.partition("_")
    return f"{what} [{unit.replace('_', '/')}]"


def _body_errors(
    index: StateIndex, body: str, states: np.ndarray, estimates: np.ndarray
) -> list[float]:
    """Errors of position [mm], attitude [mrad], velocity [m/s] and rotation [rad/s]."""
    pose, velocity = index.pose(body), index.velocity(body)
    true, seen = states[:, pose], estimates[:, pose]
    turned = to_rotation_vector(multiply(conjugate(true[:, 3:]), seen[:, 3:]))
    linear, angular = np.split(estimates[:, velocity] - states[:, velocity], 2, axis=1)
    return [_rms(seen[:, :3] - true[:, :3]) * 1e3, _rms(turned) * 1e3, _rms(linear), _rms(angular)]


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))))
