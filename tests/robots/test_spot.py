from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.errors import UsageError
from sumo_dist.robots.spot import SPOT, spot_actions

UNSTOWED = [0.0, -0.9, 1.8, 0.0, -0.9, 0.0]
PARTS = ("arm", "gripper", "legs", "torso")
FRONT_LEFT, FRONT_RIGHT, GRIPPER = slice(10, 13), slice(13, 16), 9


def test_the_stance_is_standing_with_the_arm_unstowed():
    np.testing.assert_array_equal(SPOT.stand[:6], [0.12, 0.72, -1.45, -0.12, 0.72, -1.45])
    np.testing.assert_array_equal(SPOT.stand[6:12], SPOT.stand[:6])
    np.testing.assert_array_equal(SPOT.stand[12:], [*UNSTOWED, 0.0])
    assert len(SPOT.joints) == len(SPOT.stand) == len(SPOT.sit) == 19


def test_base_and_arm_are_nine_dimensions_with_the_policy_limits():
    actions = spot_actions()
    assert actions.size == 9
    pi = np.pi
    np.testing.assert_allclose(actions.lower, [-0.7] * 3 + [-1, -1.9, 1, -pi / 2, -1.6, -pi / 4])
    np.testing.assert_allclose(actions.upper, [0.7] * 3 + [1, -0.1, 2.4, pi / 2, 0, pi / 4])
    np.testing.assert_array_equal(actions.default, [0, 0, 0, *UNSTOWED])


@pytest.mark.parametrize(
    ("parts", "size"),
    [((), 3), (("arm",), 9), (("arm", "gripper"), 10), (("legs",), 10), (PARTS, 19)],
)
def test_each_part_adds_its_dimensions(parts, size):
    actions = spot_actions(**{part: part in parts for part in PARTS})
    assert actions.size == len(actions.names) == size


@pytest.mark.parametrize("wanted", list(np.ndindex(2, 2, 2, 2)))
def test_the_default_action_stands_and_waits(wanted):
    actions = spot_actions(**dict(zip(PARTS, map(bool, wanted), strict=True)))
    assert (actions.lower <= actions.default).all()
    assert (actions.default <= actions.upper).all()
    np.testing.assert_array_equal(actions.to_command(actions.default), SPOT.default_command)


def test_the_default_command_holds_the_stances_arm_and_leaves_the_legs_to_the_policy():
    expected = [0, 0, 0, *UNSTOWED, 0, *[0] * 12, 0, 0, 0.52]
    np.testing.assert_array_equal(SPOT.default_command, expected)


@pytest.mark.parametrize(
    ("selection", "left", "right"),
    [(-1, 1, 0), (-0.51, 1, 0), (-0.5, 0, 0), (0, 0, 0), (0.5, 0, 0), (0.51, 0, 1), (1, 0, 1)],
)
def test_leg_selection_keeps_one_front_leg_or_none(selection, left, right):
    actions = spot_actions(legs=True)
    action = actions.default.copy()
    action[actions.names.index("leg_selection")] = selection
    command = actions.to_command(action)
    np.testing.assert_array_equal(command[FRONT_LEFT], left * np.array([0.12, 0.72, -1.45]))
    np.testing.assert_array_equal(command[FRONT_RIGHT], right * np.array([-0.12, 0.72, -1.45]))
    assert not command[16:22].any()


@pytest.mark.parametrize(
    ("action", "target"), [(-1, -1.54), (-0.01, -1.54), (0, -1.54), (0.01, 0.0), (1, 0.0)]
)
def test_the_gripper_is_open_or_closed(action, target):
    actions = spot_actions(gripper=True)
    full = actions.default.copy()
    full[actions.names.index("gripper")] = action
    assert actions.to_command(full)[GRIPPER] == target


def test_torso_actions_are_pitch_and_height():
    actions = spot_actions(arm=False, torso=True)
    command = actions.to_command(np.array([0.1, 0.2, 0.3, -0.4, 0.6]))
    np.testing.assert_array_equal(command[:3], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(command[22:], [0.0, -0.4, 0.6])


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_a_batch_gives_the_bits_of_its_rows(seed, rows):
    actions = spot_actions(gripper=True, legs=True, torso=True)
    unit = np.random.default_rng(seed).uniform(-1, 1, (rows, 4, actions.size))
    whole = actions.commands(unit)
    assert whole.shape == (rows, 4, 25)
    for i in range(rows):
        np.testing.assert_array_equal(whole[i], actions.commands(unit[i]))
        np.testing.assert_array_equal(whole[i, 2], actions.commands(unit[i, 2]))


def test_a_limb_has_its_noise_and_a_dimension_its_limits():
    actions = spot_actions(gripper=True, noise={"base": 2.0, "gripper": 0.5})
    assert actions.noise.tolist() == [2.0] * 3 + [1.0] * 6 + [0.5]
    changed = actions.within("gripper", upper=0.0, default=-0.5)
    assert (changed.lower[-1], changed.upper[-1], changed.default[-1]) == (-1.0, 0.0, -0.5)
    assert np.array_equal(changed.upper[:-1], actions.upper[:-1])
    assert actions.upper[-1] == 1.0


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (lambda: spot_actions(noise={"torso": 0.5}), "unknown limb of noise 'torso'; valid: .*arm"),
        (lambda: spot_actions(noise={"arm": 0.0}), "noise must be a positive number, or one"),
        (lambda: replace(spot_actions(), noise=np.ones(2)), "or one for each of 9 dimensions"),
        (lambda: spot_actions().within("tail", upper=1.0), "unknown dimension of an action 'tail'"),
        (lambda: spot_actions().within("base_vx", upper=-2.0), "lower limit exceeds its upper"),
    ],
)
def test_noise_and_limits_that_cannot_be_are_refused(wrong, reason):
    with pytest.raises(UsageError, match=reason):
        wrong()
