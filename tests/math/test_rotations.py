import mujoco
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sumo_dist.math.rotations import (
    conjugate,
    from_rotation_vector,
    matrix,
    multiply,
    rotate,
    rotate_inverse,
    slerp,
    to_rotation_vector,
)

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])

vectors = arrays(np.float64, 3, elements=st.floats(-10, 10))
quats = (
    arrays(np.float64, 4, elements=st.floats(-1, 1))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
fractions = st.floats(0, 1)


def same_rotation(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-9) -> bool:
    return min(np.abs(a - b).max(), np.abs(a + b).max()) < tolerance


@given(quats, vectors)
def test_rotates_as_mujoco_does(quat, vector):
    expected = np.empty(3)
    mujoco.mju_rotVecQuat(expected, vector, quat)
    np.testing.assert_allclose(rotate(quat, vector), expected, atol=1e-12)


@given(quats, quats)
def test_multiplies_as_mujoco_does(left, right):
    expected = np.empty(4)
    mujoco.mju_mulQuat(expected, left, right)
    np.testing.assert_allclose(multiply(left, right), expected, atol=1e-12)


@given(quats, vectors)
def test_the_inverse_undoes_a_rotation(quat, vector):
    np.testing.assert_allclose(rotate_inverse(quat, rotate(quat, vector)), vector, atol=1e-12)
    assert same_rotation(multiply(quat, conjugate(quat)), IDENTITY)


@given(quats)
def test_a_rotation_vector_is_the_same_rotation(quat):
    vector = to_rotation_vector(quat)
    assert np.linalg.norm(vector) <= np.pi + 1e-12
    assert same_rotation(from_rotation_vector(vector), quat)


def test_no_rotation_has_no_singularity():
    np.testing.assert_array_equal(to_rotation_vector(IDENTITY), np.zeros(3))
    np.testing.assert_array_equal(from_rotation_vector(np.zeros(3)), IDENTITY)
    tiny = np.array([1e-200, 0.0, 0.0])
    np.testing.assert_allclose(to_rotation_vector(from_rotation_vector(tiny)), tiny)


@given(quats, quats)
def test_slerp_joins_its_ends_whatever_their_sign(start, end):
    for signed in (end, -end):
        assert same_rotation(slerp(start, signed, 0.0), start)
        assert same_rotation(slerp(start, signed, 1.0), end)


@given(quats, quats, fractions)
def test_slerp_turns_at_constant_rate_the_short_way(start, end, fraction):
    whole = np.linalg.norm(to_rotation_vector(multiply(conjugate(start), end)))
    middle = slerp(start, end, fraction)
    part = np.linalg.norm(to_rotation_vector(multiply(conjugate(start), middle)))
    np.testing.assert_allclose(part, fraction * whole, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(middle), 1.0, atol=1e-12)


def test_a_batch_gives_the_bits_of_its_rows():
    rng = np.random.default_rng(0)
    start, end = rng.normal(size=(2, 3, 5, 4))
    start /= np.linalg.norm(start, axis=-1, keepdims=True)
    end /= np.linalg.norm(end, axis=-1, keepdims=True)
    vector, fraction = rng.normal(size=(3, 5, 3)), rng.uniform(size=(3, 5))
    turned, between = rotate(start, vector), slerp(start, end, fraction)
    for i in np.ndindex(3, 5):
        np.testing.assert_array_equal(turned[i], rotate(start[i], vector[i]))
        np.testing.assert_array_equal(between[i], slerp(start[i], end[i], fraction[i]))


def test_matrices_are_mujocos():
    quats = np.random.default_rng(0).normal(size=(20, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    expected = np.empty((20, 9))
    for quat, flat in zip(quats, expected, strict=True):
        mujoco.mju_quat2Mat(flat, quat)
    np.testing.assert_allclose(matrix(quats).reshape(20, 9), expected, atol=1e-14)
