import mujoco
import numpy as np
import pytest

from sumo_dist.costs.parameters import Parameters
from sumo_dist.costs.view import ViewLayout
from sumo_dist.errors import UsageError
from sumo_dist.model.frames import FrameRef

MODEL = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body name="first"><freejoint/><geom size="0.1"/>
      <body name="arm"><joint name="hinge"/><geom size="0.1"/><site name="tip"/></body>
    </body>
    <body name="second"><freejoint/><geom size="0.1"/></body>
    <body name="gate"><joint name="slide" type="slide"/><geom size="0.1"/></body>
    <body name="ball"><joint name="socket" type="ball"/><geom size="0.1"/></body>
  </worldbody>
  <actuator><position joint="hinge"/></actuator>
</mujoco>
""")
FRAMES = {
    "tip": FrameRef("site", "tip"),
    "thing": FrameRef("body", "second"),
    "arm": FrameRef("body", "arm"),
}


@pytest.fixture
def view():
    rows, steps = 2, 4
    states = np.arange(rows * steps * (MODEL.nq + MODEL.nv), dtype=float)
    targets = np.arange(rows * steps, dtype=float).reshape(rows, steps, 1)
    positions = np.arange(rows * steps * 3 * 3, dtype=float).reshape(rows, steps, 3, 3)
    rotations = np.arange(rows * steps * 3 * 9, dtype=float).reshape(rows, steps, 3, 3, 3)
    layout = ViewLayout(MODEL, FRAMES)
    states, actions = states.reshape(rows, steps, -1), np.zeros((rows, steps, 9))
    named = layout.view(
        *(states, targets, positions, rotations, actions), Parameters({"goal": np.array([1.0, 2])})
    )
    return named, (states, positions, rotations)


def test_frames_are_named_in_the_tasks_order(view):
    named, (_, positions, rotations) = view
    assert np.array_equal(named.tip.pos, positions[:, :, 0])
    assert np.array_equal(named.thing.pos, positions[:, :, 1])
    assert np.array_equal(named.arm.rot, rotations[:, :, 2])


def test_axes_are_the_columns_of_the_rotation(view):
    named, (_, _, rotations) = view
    for axis, column in (("x", 0), ("y", 1), ("z", 2)):
        assert np.array_equal(getattr(named.tip, axis), rotations[:, :, 0, :, column])


def test_velocities_are_those_of_the_free_body(view):
    named, (states, _, _) = view
    start = MODEL.nq + 6 + 1  # after the first body's six and the hinge
    assert np.array_equal(named.thing.linvel, states[..., start : start + 3])
    assert np.array_equal(named.thing.angvel, states[..., start + 3 : start + 6])


@pytest.mark.parametrize("frame", ["tip", "arm"])
def test_a_frame_without_a_velocity_says_so(view, frame):
    named, _ = view
    with pytest.raises(UsageError, match=f"frame '{frame}' has no velocity: it is not a body"):
        _ = getattr(named, frame).linvel


def test_an_unknown_frame_names_the_valid_ones(view):
    named, _ = view
    with pytest.raises(UsageError, match="unknown frame 'gripper'; valid: arm, thing, tip"):
        _ = named.gripper


def test_frames_are_looked_up_as_well(view):
    named, _ = view
    assert named["thing"] is named.thing
    with pytest.raises(UsageError, match="unknown frame 'gripper'; valid: arm, thing, tip"):
        named["gripper"]


def test_parameters_are_there_by_name(view):
    named, _ = view
    assert named.p.goal.tolist() == [1.0, 2.0]
    with pytest.raises(UsageError, match="unknown parameter 'radius'; valid: goal"):
        _ = named.p.radius


def test_joints_are_there_by_name(view):
    """Of all bodies, hinges and slides; a free joint is a frame's, a ball joint nobody's."""
    named, (states, _, _) = view
    assert tuple(named.joints) == ("hinge", "slide")
    assert len(named.joints) == 2
    in_qpos = {"hinge": 7, "slide": 15}  # after one free joint, after both and the hinge
    in_qvel = {"hinge": 6, "slide": 13}
    for name, joint in named.joints.items():
        assert np.array_equal(joint.pos, states[..., in_qpos[name]])
        assert np.array_equal(joint.vel, states[..., MODEL.nq + in_qvel[name]])
    with pytest.raises(UsageError, match="unknown joint 'socket'; valid: hinge, slide"):
        named.joints["socket"]


def test_a_joint_that_a_servo_drives_has_its_target(view):
    named, _ = view
    assert named.joints["hinge"].target.tolist() == [[0.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 7.0]]
    with pytest.raises(UsageError, match="no servo drives it"):
        _ = named.joints["slide"].target


def test_a_simulations_present_is_one_step_of_one_rollout():
    data = mujoco.MjData(MODEL)
    data.qpos[:] = np.arange(MODEL.nq)
    data.qvel[:] = -np.arange(MODEL.nv)
    data.ctrl[:] = 0.7
    mujoco.mj_kinematics(MODEL, data)
    now = ViewLayout(MODEL, FRAMES).at(data, 3)
    assert np.array_equal(now.tip.pos[0, 0], data.site("tip").xpos)
    assert now.thing.linvel.tolist() == [[[-7.0, -8.0, -9.0]]]
    assert now.joints["slide"].pos.tolist() == [[15.0]]
    assert now.joints["slide"].vel.tolist() == [[-13.0]]
    assert now.joints["hinge"].target.tolist() == [[0.7]]
    data.qpos[:] = 0.0  # a view is a copy of the present, whatever the simulation does
    assert now.joints["slide"].pos.tolist() == [[15.0]]
    assert now.actions.shape == (1, 1, 3)
