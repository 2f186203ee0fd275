"""The native policies take their layout from Python, and refuse one that does not fit."""

import pytest

from sumo_dist.policies import g1_layout, load_policy, spot_layout
from sumo_dist.policies.hold import hold_targets

native = pytest.importorskip("sumo_dist.rollout.native", reason="not compiled here")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("JOINTS_TO_NETWORK", (*range(18), 19), "joint index out of range"),
        ("ACTION_TO_LEGS", (*range(11), -1), "joint index out of range"),
        ("JOINTS_TO_NETWORK", tuple(range(18)), "numbers of joints"),
        ("JOINT_OFFSETS", (0.0,) * 11, "numbers of joints"),
        ("LEG_SIZE", 0, "numbers of joints"),
        ("LEG_SIZE", 5, "numbers of joints"),
        ("COMMAND_ARM_JOINTS", slice(19, 26), "targets lie outside the command"),
        ("COMMAND_LEGS", slice(-1, 11), "targets lie outside the command"),
        ("COMMAND_SIZE", 26, "the network does not fit"),
    ],
)
def test_spot_refuses_what_does_not_fit(policy, monkeypatch, name, value, message):
    monkeypatch.setattr(spot_layout, name, value)
    with pytest.raises(ValueError, match=message):
        native.native_policy(policy, portable=True)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("JOINT_OFFSETS", (0.0,) * 14, "numbers of joints"),
        ("JOINT_OFFSETS", (0.0,) * 36, "outside the command"),
        ("ARM_SIZE", 0, "numbers of joints"),
        ("ARM_SIZE", 3, "numbers of joints"),
        ("COMMAND_ARMS", slice(6, 20), "outside the command"),
        ("COMMAND_FOLLOWS", slice(18, 20), "outside the command"),
        ("MEMORY_GAIT", 28, "outside the memory"),
        ("MEMORY_VELOCITY", slice(31, 34), "outside the memory"),
        ("PHASES", g1_layout.PHASES[:1], "without phases"),
    ],
)
def test_g1_refuses_what_does_not_fit(monkeypatch, name, value, message):
    policy = load_policy("g1")
    monkeypatch.setattr(g1_layout, name, value)
    with pytest.raises(ValueError, match=message):
        native.native_policy(policy, portable=True)


def test_a_network_of_another_policy_is_refused(policy):
    with pytest.raises(ValueError, match="g1_gait: the network does not fit"):
        native.NATIVE_POLICIES[g1_layout.KIND](policy, True)


def test_joint_targets_need_no_layout(policy):
    native.native_policy(hold_targets(policy.contract), portable=True)
