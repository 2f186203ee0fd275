import dataclasses

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.estimate import make_estimator


@pytest.fixture
def oracle(motion):
    """Readings of a robot that knows its true state and sends no packets."""
    none = {"encoder_ms": np.empty(0, np.int64), "encoders": np.empty((0, 38))}
    none |= {"mocap_ms": np.empty(0, np.int64), "mocap": np.empty((0, 2, 7))}
    return dataclasses.replace(motion.readings(3), truth=motion.state(3), **none)


def test_truth_passes_the_plants_state_through(model, oracle):
    np.testing.assert_array_equal(make_estimator("truth", model)(oracle), oracle.truth)


def test_an_unknown_mode_names_the_valid_ones(model):
    with pytest.raises(UsageError, match=r"estimator 'kalman'; valid: lowpass, truth"):
        make_estimator("kalman", model)


def test_truth_from_a_robot_that_sends_packets_points_to_lowpass(model, motion):
    with pytest.raises(UsageError, match=r"sends sensor packets.*valid.*lowpass"):
        make_estimator("truth", model)(motion.readings(3))


def test_lowpass_from_a_robot_that_sends_its_state_points_to_truth(model, oracle):
    with pytest.raises(UsageError, match=r"no sensor packets.*valid.*truth"):
        make_estimator("lowpass", model)(oracle)


def test_a_true_state_of_another_scene_is_refused(model, oracle):
    with pytest.raises(SumoError, match=r"shape \(10,\); this scene's have \(64,\)"):
        make_estimator("truth", model)(dataclasses.replace(oracle, truth=np.zeros(10)))


def test_lowpass_refuses_a_scene_with_a_joint_that_no_sensor_sees():
    door = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
             <body><freejoint/><geom size=".1"/></body>
             <body><joint name="door_hinge"/><geom size=".1"/></body>
           </worldbody></mujoco>"""
    )
    with pytest.raises(UsageError, match=r"door_hinge.*valid for this scene: truth"):
        make_estimator("lowpass", door)
