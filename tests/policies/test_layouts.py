"""The layouts, and that they are had without the weights' reader."""

import subprocess
import sys

import numpy as np
import pytest

from sumo_dist.policies import g1_layout, spot_layout
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.spot import SPOT


@pytest.mark.parametrize("module", ["policies.spot_layout", "policies.g1_layout", "robots.spot"])
def test_a_layout_is_had_without_onnx(module):
    code = f"import sys, sumo_dist.{module}; print('onnx' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "False\n"


def places(size, *parts):
    return np.concatenate([np.arange(size)[part] for part in parts]).tolist()


def test_spots_command_is_made_of_its_parts():
    layout = spot_layout
    assert len(SPOT.default_command) == layout.COMMAND_SIZE
    parts = layout.COMMAND_BASE, layout.COMMAND_ARM_JOINTS, layout.COMMAND_LEGS, slice(22, None)
    assert places(25, *parts) == list(range(25))
    arm = places(25, layout.COMMAND_ARM, layout.COMMAND_GRIPPER)
    assert arm == places(25, layout.COMMAND_ARM_JOINTS)
    assert len(arm) == len(layout.ARM_JOINTS)
    legs = places(25, layout.COMMAND_LEGS)
    assert len(legs) == len(layout.LEG_JOINTS) == len(layout.LEGS) * layout.LEG_SIZE
    assert places(25, layout.COMMAND_FRONT_LEFT, layout.COMMAND_FRONT_RIGHT) == legs[:6]
    assert layout.LEG_JOINTS[3] == "fr_hx"


def test_spots_networks_order_has_every_joint_once():
    layout = spot_layout
    assert sorted(layout.NETWORK_JOINTS) == sorted(layout.JOINTS)
    assert SPOT.joints == layout.JOINTS
    assert len(layout.KP) == len(layout.KD) == len(layout.JOINT_OFFSETS) == len(layout.JOINTS)


def test_g1s_command_and_memory_are_made_of_their_parts():
    layout = g1_layout
    assert len(G1.default_command) == layout.COMMAND_SIZE
    parts = layout.COMMAND_BASE, layout.COMMAND_ARMS, layout.COMMAND_FOLLOWS
    assert places(19, *parts) == list(range(19))
    memory = slice(layout.ACTION_SIZE), slice(layout.MEMORY_GAIT, 30), layout.MEMORY_VELOCITY
    assert places(layout.MEMORY_SIZE, *memory) == list(range(33))


def test_g1s_arms_are_its_last_joints():
    layout = g1_layout
    arms = layout.JOINTS[layout.ARMS]
    assert len(arms) == len(layout.SIDES) * layout.ARM_SIZE
    assert all("shoulder" in arms[side * layout.ARM_SIZE] for side in range(2))
    assert [arms[0].split("_")[0], arms[layout.ARM_SIZE].split("_")[0]] == list(layout.SIDES)
    assert G1.joints == layout.JOINTS
    assert layout.JOINT_OFFSETS[layout.ARMS] == layout.LEFT_ARM_OFFSETS + layout.RIGHT_ARM_OFFSETS
