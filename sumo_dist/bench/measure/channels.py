"""How far estimated states are from the true ones, channel by channel."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from sumo_dist.math.rotations import conjugate, multiply, to_rotation_vector
from sumo_dist.model.index import StateIndex
from sumo_dist.robots.spot import SPOT


class Errors(NamedTuple):
    """Root mean square of what each channel is off, over time, per vector."""

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
    base, box = (list(_body(index, body, states, estimates, off)) for body in ("body", "box"))
    return Errors._make([*base, *joints, *box])


def mean_errors(errors: Iterable[Errors | None]) -> Errors:
    """Root mean square over walks but those of None; nan if no other is left."""
    measured = [each for each in errors if each is not None]
    if not measured:
        return Errors._make([np.nan] * len(Errors._fields))
    return Errors._make(np.sqrt(np.square(np.array(measured)).mean(axis=0)).round(4).tolist())


def title(channel: str) -> str:
    """Head a column of errors, with its unit."""
    what, _, unit = channel.partition("_")
    return f"{what} [{unit.replace('_', '/')}]"


def _body(
    index: StateIndex, body: str, states: np.ndarray, estimates: np.ndarray, off: np.ndarray
) -> Iterator[float]:
    pose, velocity = index.pose(body), index.velocity(body)
    turned = multiply(conjugate(states[:, pose][:, 3:]), estimates[:, pose][:, 3:])
    yield _rms(off[:, pose][:, :3]) * 1e3
    yield _rms(to_rotation_vector(turned)) * 1e3
    yield from (_rms(part) for part in np.split(off[:, velocity], 2, axis=1))


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))))
