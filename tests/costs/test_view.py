import mujoco
import numpy as np
import pytest

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
  </worldbody>
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
    positions = np.arange(rows * steps * 3 * 3, dtype=float).reshape(rows, steps, 3, 3)
    rotations = np.arange(rows * steps * 3 * 9, dtype=float).reshape(rows, steps, 3, 3, 3)
    layout = ViewLayout(MODEL, FRAMES)
    return layout.view(
        states.reshape(rows, steps, -1), positions, rotations, np.zeros((rows, steps, 9))
    ), (states.reshape(rows, steps, -1), positions, rotations)


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
