import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.policies import g1 as policy
from sumo_dist.robots.g1 import G1, SIDES, g1_actions

ARMS = [(), ("left",), ("right",), SIDES]


def test_stance_and_squat_have_an_angle_for_every_joint():
    assert len(G1.joints) == len(G1.stand) == len(G1.sit) == 29
    assert G1.stand == policy.JOINT_OFFSETS
    assert len(G1.default_command) == policy.COMMAND_SIZE


@pytest.mark.parametrize("arms", ARMS)
def test_base_and_four_joints_an_arm(arms):
    actions = g1_actions(arms)
    assert actions.size == len(actions.names) == 3 + 4 * len(arms)
    np.testing.assert_allclose(actions.upper[:3], [0.8, 0.4, 0.5])
    np.testing.assert_array_equal(actions.lower[:3], -actions.upper[:3])
    np.testing.assert_allclose(actions.upper[3:] - actions.default[3:], 1.0)


@pytest.mark.parametrize("arms", ARMS)
def test_the_default_action_stands_exactly(arms):
    """The middle of the search is the default: no rounding may set the robot walking."""
    actions = g1_actions(arms)
    command = actions.commands(actions.unit(actions.default))
    np.testing.assert_array_equal(command[:3], 0.0)
    np.testing.assert_allclose(command[3:17], G1.default_command[3:17], atol=1e-15)
    assert command[17:].tolist() == ["left" in arms, "right" in arms]


def test_actions_land_on_their_joints():
    command = g1_actions(SIDES).to_command(np.arange(11.0))
    assert command[:3].tolist() == [0.0, 1.0, 2.0]
    assert command[3:10].tolist() == [3.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0]
    assert command[10:17].tolist() == [7.0, 8.0, 9.0, 10.0, 0.0, 0.0, 0.0]
    right = g1_actions(("right",)).to_command(np.arange(7.0))
    assert right[10:14].tolist() == [3.0, 4.0, 5.0, 6.0]
    assert right[3:7].tolist() == [0.2, 0.2, 0.0, 0.6]


def test_other_arms_are_refused():
    for arms in (("third",), ("right", "left"), "left"):
        with pytest.raises(UsageError, match="arms are"):
            g1_actions(arms)
