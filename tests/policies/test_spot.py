import warnings

import mujoco
import numpy as np
import onnx
import pytest
from onnx.reference import ReferenceEvaluator

from sumo_dist.errors import SumoError
from sumo_dist.policies import policy_file
from sumo_dist.policies import spot as layout
from sumo_dist.policies.network import evaluate

NQ, NV = 33, 31  # the robot's 26 and 25, and a free object behind it


def random_inputs(count, seed=0):
    rng = np.random.default_rng(seed)
    qpos = rng.normal(size=(count, NQ))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    command = rng.normal(size=(count, 25))
    command[: count // 2, 10:22] = 0.0
    return qpos, rng.normal(size=(count, NV)), command, rng.normal(size=(count, 12)).astype("f4")


def standing():
    qpos = np.zeros(NQ)
    qpos[:7] = 0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0
    qpos[7:26] = layout.JOINT_OFFSETS
    return qpos


def test_network_and_contract(spot):
    sizes = [layer.weight.shape for layer in spot.layers]
    assert sizes == [(512, 84), (256, 512), (128, 256), (12, 128)]
    assert spot.kind == "spot_relic"
    assert [layer.activation for layer in spot.layers] == ["elu", "elu", "elu", "linear"]
    assert all(layer.norm is None and layer.gain is None for layer in spot.layers)
    contract = spot.contract
    assert contract.observation_size == 84
    assert (contract.command_size, contract.action_size, contract.memory_size) == (25, 12, 12)
    assert contract.rate_hz == 50.0
    assert contract.weights_sha256.startswith("039b542d7e83")
    assert len(contract.joints) == len(contract.kp) == len(contract.kd) == 19


@pytest.mark.parametrize(("spread", "tolerance"), [(0.1, 1e-5), (1.0, 1e-4)])
def test_network_agrees_with_the_onnx_reference(spot, spread, tolerance):
    """Outputs are below 10 as in walking at the first spread, below 100 at the second."""
    reference = ReferenceEvaluator(onnx.load(policy_file("spot")))
    rows = np.random.default_rng(1).normal(scale=spread, size=(40, 84)).astype(np.float32)
    with np.errstate(over="ignore"):
        expected = np.concatenate([reference.run(None, {"obs": row[None]})[0] for row in rows])
    assert np.abs(evaluate(spot.layers, rows) - expected).max() <= tolerance


def test_joint_orders():
    # fmt: off
    assert layout.JOINTS_TO_NETWORK == (
        12, 0, 3, 6, 9, 13, 1, 4, 7, 10, 14, 2, 5, 8, 11, 15, 16, 17, 18
    )
    assert layout.ACTION_TO_LEGS == (0, 4, 8, 1, 5, 9, 2, 6, 10, 3, 7, 11)
    # fmt: on


def test_observation_layout():
    half = np.sqrt(0.5)
    qpos, qvel = standing(), np.zeros(NV)
    qpos[3:7] = half, 0.0, 0.0, half  # turned left: its x axis is the world's y
    qpos[7:26] += np.arange(19) / 100
    qpos[26:] = 9.0
    qvel[:6] = 1.0, 2.0, 3.0, 0.1, 0.2, 0.3
    qvel[6:25] = np.arange(19)
    qvel[25:] = 9.0
    command = np.arange(25) + 0.5
    memory = np.arange(12, dtype=np.float32) - 6
    seen = layout.observation(qpos, qvel, command, memory)

    network = [12, 0, 3, 6, 9, 13, 1, 4, 7, 10, 14, 2, 5, 8, 11, 15, 16, 17, 18]
    assert seen.shape == (84,)
    assert seen.dtype == np.float32
    np.testing.assert_allclose(seen[0:3], [2.0, -1.0, 3.0], atol=1e-6)
    np.testing.assert_allclose(seen[3:6], [0.1, 0.2, 0.3], rtol=1e-6)
    np.testing.assert_allclose(seen[6:9], [0.0, 0.0, -1.0], atol=1e-6)
    np.testing.assert_array_equal(seen[9:34], command)
    np.testing.assert_allclose(seen[34:53], np.array(network) / 100, atol=1e-6)
    np.testing.assert_array_equal(seen[53:72], network)
    np.testing.assert_array_equal(seen[72:84], memory)


def test_gravity_when_standing_on_the_nose():
    qpos = standing()
    qpos[3:7] = np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0  # pitched down: its x axis is down
    seen = layout.observation(qpos, np.zeros(NV), np.zeros(25), np.zeros(12, np.float32))
    np.testing.assert_allclose(seen[6:9], [1.0, 0.0, 0.0], atol=1e-6)


def test_base_frame_agrees_with_mujoco():
    qpos, qvel, command, memory = random_inputs(20)
    seen = layout.observation(qpos, qvel, command, memory)
    inverse, velocity, gravity = np.zeros(4), np.zeros(3), np.zeros(3)
    for row in range(20):
        mujoco.mju_negQuat(inverse, qpos[row, 3:7])
        mujoco.mju_rotVecQuat(velocity, qvel[row, :3], inverse)
        mujoco.mju_rotVecQuat(gravity, np.array([0.0, 0.0, -1.0]), inverse)
        np.testing.assert_allclose(seen[row, :3], velocity, atol=1e-6)
        np.testing.assert_allclose(seen[row, 6:9], gravity, atol=1e-6)


def test_targets_without_override():
    action = np.arange(12, dtype=np.float32)
    command = np.zeros(25)
    command[3:10] = np.arange(7) / 10
    targets = layout.joint_targets(action, command)
    np.testing.assert_allclose(targets[0:3], [0.12 + 0.0, 0.5 + 0.8, -1.0 + 1.6])
    np.testing.assert_allclose(targets[3:6], [-0.12 + 0.2, 0.5 + 1.0, -1.0 + 1.8])
    np.testing.assert_allclose(targets[9:12], [-0.12 + 0.6, 0.5 + 1.4, -1.0 + 2.2])
    np.testing.assert_array_equal(targets[12:], command[3:10])


@pytest.mark.parametrize("legs", [(0,), (3,), (0, 1), (1, 2), (0, 1, 2, 3)])
def test_every_commanded_leg_is_overridden(legs):
    action = np.ones(12, np.float32)
    command = np.zeros(25)
    free = layout.joint_targets(action, command)[:12].reshape(4, 3)
    for leg in legs:
        command[11 + 3 * leg] = 0.7  # one value is enough; the other two are literally zero
    targets = layout.joint_targets(action, command)[:12].reshape(4, 3)
    for leg in range(4):
        expected = [0.0, 0.7, 0.0] if leg in legs else free[leg]
        np.testing.assert_array_equal(targets[leg], expected)


def test_memory_is_the_raw_action_of_every_leg(spot):
    qpos, qvel, command, memory = random_inputs(4)
    command[:, 10:22] = 0.3
    targets, after = spot.step(qpos, qvel, command, memory)
    seen = layout.observation(qpos, qvel, command, memory)
    np.testing.assert_array_equal(after, evaluate(spot.layers, seen))
    np.testing.assert_array_equal(targets[:, :12], 0.3)
    assert (targets.dtype, after.dtype) == (np.float64, np.float32)
    np.testing.assert_array_equal(spot.initial_memory(), np.zeros(12))


@pytest.mark.parametrize("size", [1, 3, 8])
def test_a_row_does_not_depend_on_its_batch(spot, size):
    inputs = random_inputs(32)
    targets, memory = spot.step(*inputs)
    for start in range(0, 32, size):
        rows = slice(start, start + size)
        some_targets, some_memory = spot.step(*(array[rows] for array in inputs))
        np.testing.assert_array_equal(some_targets, targets[rows])
        np.testing.assert_array_equal(some_memory, memory[rows])


def test_a_single_state_is_a_batch_of_one(spot):
    inputs = random_inputs(5)
    targets, memory = spot.step(*inputs)
    one_targets, one_memory = spot.step(*(array[2] for array in inputs))
    assert one_targets.shape == (19,)
    np.testing.assert_array_equal(one_targets, targets[2])
    np.testing.assert_array_equal(one_memory, memory[2])


def test_a_diverged_row_leaves_the_others_alone(spot):
    qpos, qvel, command, memory = random_inputs(6)
    expected, _ = spot.step(qpos, qvel, command, memory)
    qpos[1], qvel[4] = np.nan, 1e300
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        targets, after = spot.step(qpos, qvel, command, memory)
    sane = [0, 2, 3, 5]
    np.testing.assert_array_equal(targets[sane], expected[sane])
    assert not np.isfinite(after[[1, 4]]).any()


@pytest.mark.parametrize("name", ["qpos", "qvel", "command", "memory"])
def test_wrong_shapes_are_named(spot, name):
    inputs = dict(zip(("qpos", "qvel", "command", "memory"), random_inputs(2), strict=True))
    inputs[name] = inputs[name][:, :11]
    with pytest.raises(SumoError, match=rf"{name}.*\(2, 11\)"):
        spot.step(**inputs)
