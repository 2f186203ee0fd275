import warnings

import numpy as np
import onnx
import pytest
from onnx.reference import ReferenceEvaluator

from sumo_dist.errors import SumoError
from sumo_dist.policies import g1 as layout
from sumo_dist.policies import policy_file
from sumo_dist.policies.network import evaluate
from sumo_dist.robots.g1 import G1

NQ, NV = 43, 41  # the robot's 36 and 35, and a free object behind it
LEFT, RIGHT = slice(15, 22), slice(22, 29)  # among the joints


def standing():
    """State, command and memory of a robot that stands, and has always stood."""
    qpos = np.zeros(NQ)
    qpos[:7] = 0.0, 0.0, 0.76, 1.0, 0.0, 0.0, 0.0
    qpos[7:36] = layout.JOINT_OFFSETS
    memory = np.zeros(layout.MEMORY_SIZE, np.float32)
    memory[layout.MEMORY_GAIT] = layout.STANDING
    return qpos, np.zeros(NV), np.array(G1.default_command), memory


def random_inputs(count, seed=0):
    rng = np.random.default_rng(seed)
    qpos = rng.normal(size=(count, NQ))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    command = rng.normal(size=(count, layout.COMMAND_SIZE))
    command[:, layout.COMMAND_FOLLOWS] = rng.integers(0, 2, (count, 2))
    command[::4, :3] = 0.0
    memory = rng.normal(size=(count, layout.MEMORY_SIZE)).astype(np.float32)
    memory[:, layout.MEMORY_GAIT] = rng.integers(-1, layout.GAIT_TICKS, count)
    return qpos, rng.normal(size=(count, NV)), command, memory


def seen(qpos, qvel, command, memory):
    """What the network sees."""
    gait, _, wish = layout.advance(qpos, qvel, command, memory)
    return layout.observation(qpos, qvel, command, memory[..., :29], gait, wish)


def test_contract_and_networks(g1):
    contract = g1.contract
    assert contract.joints == layout.JOINTS == G1.joints
    assert (contract.observation_size, contract.action_size) == (100, 29)
    assert (contract.command_size, contract.memory_size, contract.rate_hz) == (19, 33, 50.0)
    sizes = [layer.weight.shape for layer in g1.layers]
    assert sizes == [(512, 100), (256, 512), (128, 256), (29, 128)]
    fastsac = contract.name == "g1"
    activations = [layer.activation for layer in g1.layers]
    assert activations == (["silu"] * 3 + ["tanh"] if fastsac else ["elu"] * 3 + ["linear"])
    assert [layer.norm is not None for layer in g1.layers] == [fastsac] * 3 + [False]


def test_gains_come_from_the_weights_file(g1):
    """A motor's own inertia makes 10 Hz and twice the critical damping."""
    inertia = {"hip_pitch": 0.0101775, "knee": 0.0251019, "elbow": 0.00360972}
    for joint, armature in inertia.items():
        index = layout.JOINTS.index(f"left_{joint}_joint")
        kp = armature * (20.0 * np.pi) ** 2
        assert g1.contract.kp[index] == pytest.approx(kp, rel=1e-4)
        assert g1.contract.kd[index] == pytest.approx(4.0 * armature * 20.0 * np.pi, rel=1e-4)


def test_network_agrees_with_the_onnx_reference(g1):
    reference = ReferenceEvaluator(onnx.load(policy_file(g1.contract.name)))
    rows = np.random.default_rng(1).normal(size=(20, 100)).astype(np.float32)
    with np.errstate(over="ignore"):
        expected = [reference.run(None, {"actor_obs": row[None]})[0][0] for row in rows]
    assert np.abs(evaluate(g1.layers, rows) - expected).max() <= 2e-5  # outputs are below 25


def test_the_observation_of_standing_is_zero_but_for_gravity_and_phase():
    found = seen(*standing())
    expected = np.zeros(100)
    expected[35:37] = -1.0  # cosines: both phases are pi
    expected[97] = -1.0  # gravity
    np.testing.assert_array_equal(found, expected.astype(np.float32))


def test_the_layout_of_the_observation():
    qpos, qvel, command, memory = standing()
    memory[:29] = np.arange(29)
    qvel[3:6] = 4.0, 8.0, 12.0
    qpos[7:36] += np.arange(29) / 8
    qvel[6:35] = 20.0 * np.arange(29)
    found = seen(qpos, qvel, command, memory)
    np.testing.assert_array_equal(found[:29], np.arange(29))
    np.testing.assert_array_equal(found[29:32], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found[37:66], np.arange(29) / 8, atol=1e-7)
    np.testing.assert_array_equal(found[66:95], np.arange(29))


def test_gravity_and_velocity_are_in_the_bases_frame():
    qpos, qvel, command, memory = standing()
    half = np.sqrt(0.5)
    qpos[3:7] = half, 0.0, 0.0, half  # yaw 90 deg: the base's x is the world's y
    qvel[:3] = 0.0, 2.0, 0.0
    _, velocity, _ = layout.advance(qpos, qvel, command, memory)
    np.testing.assert_allclose(velocity, [2.0 * layout.FEEDBACK_SHARE, 0.0, 0.0], atol=1e-7)
    qpos[3:7] = half, 0.0, half, 0.0  # pitch 90 deg: it looks at the floor
    np.testing.assert_allclose(seen(qpos, qvel, command, memory)[95:98], [1.0, 0.0, 0.0], atol=1e-7)


def test_the_gait_begins_runs_and_rests(g1):
    qpos, qvel, command, memory = standing()
    ticks = []
    for vx in [0.0] * 2 + [0.5] * 52 + [0.0] + [0.5] * 2:
        command[0] = vx
        phases = seen(qpos, qvel, command, memory)[[35, 36, 98, 99]]
        _, memory = g1.step(qpos, qvel, command, memory)
        ticks.append(memory[layout.MEMORY_GAIT])
        expected = layout.PHASES[-1 if vx == 0.0 else int(ticks[-1] - 1) % layout.GAIT_TICKS]
        np.testing.assert_array_equal(phases, expected)
    begins = [*range(1, 50), 0, 1, 2]
    assert ticks == [-1, -1, *begins, -1, 1, 2]


def test_phases_are_half_a_period_apart():
    angle = 2 * np.pi * 7 / 50
    both = np.array([angle, angle + np.pi])
    np.testing.assert_allclose(layout.PHASES[7], [*np.cos(both), *np.sin(both)], atol=1e-7)
    np.testing.assert_array_equal(layout.PHASES[0], np.array([1, -1, 0, 0], np.float32))


def test_a_command_that_lags_is_raised_up_to_a_limit():
    qpos, qvel, command, memory = standing()
    command[:3] = 0.5, -0.25, 0.5
    found = seen(qpos, qvel, command, memory)[32:35]
    np.testing.assert_allclose(found, [0.5 + 0.3 * 0.5, 1.0, -0.5], atol=1e-6)  # wz, vx, vy
    memory[layout.MEMORY_VELOCITY] = -9.0
    assert seen(qpos, qvel, command, memory)[33] == layout.FEEDBACK_LIMIT


def test_standing_is_not_corrected():
    qpos, qvel, command, memory = standing()
    memory[layout.MEMORY_VELOCITY] = 1.0
    command[:2] = layout.STAND_BELOW / 2
    assert not seen(qpos, qvel, command, memory)[32:35].any()


@pytest.mark.parametrize(("arm", "index"), [(LEFT, 0), (RIGHT, 1)])
def test_an_arm_that_follows_is_hidden_and_followed(g1, arm, index):
    (qpos, qvel, command, memory) = (array[0] for array in random_inputs(1))
    command[17:19] = 0.0
    free, _ = g1.step(qpos, qvel, command, memory)
    command[17 + index] = 1.0
    found = seen(qpos, qvel, command, memory)
    for start in (0, 37, 66):
        part = found[start : start + 29]
        assert not part[arm].any()
        assert np.count_nonzero(part) == 22
    targets, _ = g1.step(qpos, qvel, command, memory)
    np.testing.assert_array_equal(targets[arm], command[3:17][arm.start - 15 : arm.stop - 15])
    assert (free[arm] != targets[arm]).all()


@pytest.mark.parametrize("size", [1, 5])
def test_a_row_does_not_depend_on_its_neighbours(g1, size):
    inputs = random_inputs(size)
    whole = g1.step(*inputs)
    changed = tuple(np.where(np.arange(size)[:, None] == 0, array, 0 * array) for array in inputs)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        other = g1.step(*changed)
    for ours, theirs in zip(whole, other, strict=True):
        np.testing.assert_array_equal(ours[0], theirs[0])


def test_a_diverged_row_stays_in_its_row(g1):
    qpos, qvel, command, memory = random_inputs(3)
    qpos[1], memory[1] = np.nan, np.nan
    targets, following = g1.step(qpos, qvel, command, memory)
    assert np.isfinite(targets[[0, 2]]).all()
    assert np.isfinite(following[[0, 2]]).all()
    assert np.isnan(following[1, :29]).all()


def test_refuses_wrong_shapes(g1):
    qpos, qvel, command, memory = standing()
    with pytest.raises(SumoError, match=r"command \(18,\)"):
        g1.step(qpos, qvel, command[:-1], memory)


def test_weights_without_metadata_are_refused(tmp_path, g1):
    model = onnx.load(policy_file(g1.contract.name))
    del model.metadata_props[:]
    path = tmp_path / "bare.onnx"
    onnx.save(model, path)
    with pytest.raises(SumoError, match="metadata lacks dof_names, kp or kd"):
        layout.load(_pinned(g1.contract.name), path)


def _pinned(name):
    from sumo_dist.policies.manifest import pinned_policy

    return pinned_policy(name)
