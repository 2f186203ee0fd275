"""G1's model against the numbers of the robot that its policies were trained on."""

import mujoco
import numpy as np
import pytest

from sumo_dist.model.files import ASSETS
from sumo_dist.robots.g1 import G1

# joint: range [rad], armature [kg m^2], torque [Nm], of the left side
JOINTS = {
    "hip_pitch": ((-2.5307, 2.8798), 0.0101775, 88),
    "hip_roll": ((-0.5236, 2.9671), 0.0251019, 139),
    "hip_yaw": ((-2.7576, 2.7576), 0.0101775, 88),
    "knee": ((-0.087267, 2.8798), 0.0251019, 139),
    "ankle_pitch": ((-0.87267, 0.5236), 0.00721945, 50),
    "ankle_roll": ((-0.2618, 0.2618), 0.00721945, 50),
    "shoulder_pitch": ((-3.0892, 2.6704), 0.00360972, 25),
    "shoulder_roll": ((-1.5882, 2.2515), 0.00360972, 25),
    "shoulder_yaw": ((-2.618, 2.618), 0.00360972, 25),
    "elbow": ((-1.0472, 2.0944), 0.00360972, 25),
    "wrist_roll": ((-1.97222, 1.97222), 0.00360972, 25),
    "wrist_pitch": ((-1.61443, 1.61443), 0.00425, 5),
    "wrist_yaw": ((-1.61443, 1.61443), 0.00425, 5),
}
MIRRORED = ("roll", "yaw")  # whose ranges are so on the other side


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(ASSETS / G1.mjcf))


@pytest.fixture(scope="module")
def standing(model):
    data = mujoco.MjData(model)
    data.qpos[2], data.qpos[7:] = G1.stand_height, G1.stand
    mujoco.mj_forward(model, data)
    return data


def test_mass_and_size(model):
    assert (model.nq, model.nv, model.nu) == (36, 35, 29)
    assert model.body_mass.sum() == pytest.approx(33.341142)
    assert tuple(model.joint(i + 1).name for i in range(29)) == G1.joints
    assert tuple(model.actuator(i).name for i in range(29)) == G1.joints


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", JOINTS)
def test_joints_and_motors(model, name, side):
    (low, high), armature, torque = JOINTS[name]
    if side == "right" and name.endswith(MIRRORED):
        low, high = -high, -low
    joint = model.joint(f"{side}_{name}_joint")
    motor = model.actuator(joint.name)
    assert joint.range.tolist() == [low, high]
    assert motor.ctrlrange.tolist() == pytest.approx([low, high], abs=1e-9)
    assert motor.forcerange.tolist() == [-torque, torque]
    assert model.dof_armature[joint.dofadr] == armature
    assert not model.dof_damping[joint.dofadr]
    kp = armature * (20.0 * np.pi) ** 2
    assert model.actuator_gainprm[motor.id, 0] == pytest.approx(kp, rel=1e-4)


def test_left_and_right_are_mirror_images(model, standing):
    """Bodies and what touches: the released arms differ by 10 um at the shoulder."""
    for name in [model.body(i).name for i in range(model.nbody)]:
        if name.startswith("left_"):
            other = name.replace("left", "right")
            assert model.body(name).mass == model.body(other).mass
            for of in (standing.body(name), standing.body(other)):
                assert np.isfinite(of.xipos).all()
            mirrored = standing.body(other).xipos * [1, -1, 1]
            np.testing.assert_allclose(standing.body(name).xipos, mirrored, atol=2e-4)


def test_a_foot_is_three_capsules_that_span_the_sole(model, standing):
    for side, sign in (("left", 1.0), ("right", -1.0)):
        feet = [model.geom(f"{side}_foot{i}_collision") for i in (1, 2, 3)]
        assert all(geom.condim == 3 and geom.priority == 4 for geom in feet)
        ends = []
        for geom in feet:
            at = standing.geom(geom.name)
            axis = at.xmat.reshape(3, 3)[:, 2] * geom.size[1]
            ends += [at.xpos + axis, at.xpos - axis]
        ends = np.array(ends) - standing.body(f"{side}_ankle_roll_link").xpos
        assert np.ptp(ends[:, 0]) == pytest.approx(0.184, abs=2e-3)  # heel to tip
        assert np.ptp(ends[:, 1]) == pytest.approx(0.053, abs=1e-3)
        assert abs(ends[:, 1].mean() * sign) < 1e-3


def test_what_touches_is_hidden_and_what_is_seen_does_not_touch(model):
    touches = (model.geom_contype | model.geom_conaffinity) != 0
    assert (model.geom_group[touches] == 3).all()
    assert (model.geom_group[~touches] == 2).all()
    assert 20 <= touches.sum() <= 32


def test_a_standing_robot_does_not_touch_itself(model, standing):
    assert standing.ncon == 0


def test_palms_are_at_the_hands(standing):
    left, right = standing.site("left_palm").xpos, standing.site("right_palm").xpos
    np.testing.assert_allclose(left, right * [1, -1, 1], atol=1e-4)
    assert left[0] > 0.15
    assert left[1] > 0.15
