"""Rotations as unit quaternions (w, x, y, z), over any leading dimensions.

Only elementwise operations: a batch gives the same bits however it is split.
"""

import numpy as np


def rotate(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Turn vectors (..., 3) by quaternions (..., 4): from the body's frame into the world's."""
    w, axis = quat[..., :1], quat[..., 1:]
    twice = 2.0 * np.cross(axis, vector)
    return vector + w * twice + np.cross(axis, twice)


def rotate_inverse(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Turn vectors (..., 3) by inverse quaternions (..., 4): from the world's into the body's."""
    return rotate(conjugate(quat), vector)


def conjugate(quat: np.ndarray) -> np.ndarray:
    """Return the inverse rotations (..., 4)."""
    return quat * np.array([1.0, -1.0, -1.0, -1.0])


def multiply(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Compose rotations (..., 4): the right one acts first."""
    w = left[..., :1] * right[..., :1] - np.sum(left[..., 1:] * right[..., 1:], -1, keepdims=True)
    xyz = (
        left[..., :1] * right[..., 1:]
        + right[..., :1] * left[..., 1:]
        + np.cross(left[..., 1:], right[..., 1:])
    )
    return np.concatenate([w, xyz], axis=-1)


def from_rotation_vector(vector: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of rotations about `vector` (..., 3) by its length [rad]."""
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    # np.sinc(x) = sin(pi x) / (pi x): sin(angle / 2) / angle without a division by zero
    return np.concatenate([np.cos(angle / 2), vector * np.sinc(angle / (2 * np.pi)) / 2], axis=-1)


def to_rotation_vector(quat: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), no longer than pi [rad]; q and -q give the same one."""
    quat = np.where(quat[..., :1] < 0, -quat, quat)
    sine = np.linalg.norm(quat[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, quat[..., :1])
    # angle / sin(angle / 2) tends to 2
    return quat[..., 1:] * np.divide(angle, sine, out=np.full_like(angle, 2.0), where=sine > 0)


def slerp(start: np.ndarray, end: np.ndarray, fraction: np.ndarray | float) -> np.ndarray:
    """Rotations (..., 4) on the shortest way from `start` (0) to `end` (1), fraction (...,)."""
    way = to_rotation_vector(multiply(conjugate(start), end))
    return multiply(start, from_rotation_vector(np.asarray(fraction)[..., None] * way))


def matrix(quat: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4): the body's axes as columns."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
