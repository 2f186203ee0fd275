import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.index import StateIndex, label

MJCF = """
<mujoco>
  <worldbody>
    <body name="robot">
      <freejoint name="base"/>
      <geom size="0.1"/>
      <body name="link">
        <joint name="hinge"/>
        <joint name="slide" type="slide"/>
        <geom size="0.1"/>
      </body>
    </body>
    <body name="ball"><freejoint/><geom size="0.1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MJCF)


@pytest.fixture(scope="module")
def index(model) -> StateIndex:
    return StateIndex(model)


def test_free_bodies_in_qpos_order(index):
    assert index.free_bodies == ("robot", "ball")


def test_poses_and_velocities_are_where_mujoco_keeps_them(model, index):
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.arange(model.nq), np.arange(model.nv) + 100
    state = index.pack(data.qpos, data.qvel)
    np.testing.assert_array_equal(state[index.pose("ball")], data.joint(3).qpos)
    np.testing.assert_array_equal(state[index.velocity("ball")], data.joint(3).qvel)
    np.testing.assert_array_equal(state[index.pose("robot")], data.joint("base").qpos)
    np.testing.assert_array_equal(state[index.velocity("robot")], data.joint("base").qvel)


def test_joints_in_the_order_asked_for(model, index):
    state = np.arange(model.nq + model.nv)
    positions, velocities = index.joints(("slide", "hinge"))
    np.testing.assert_array_equal(state[positions], [8, 7])
    np.testing.assert_array_equal(state[velocities], np.array([7, 6]) + model.nq)
    assert [len(addresses) for addresses in index.joints(())] == [0, 0]


def test_unpack_undoes_pack_without_copying(model, index):
    states = np.random.default_rng(0).normal(size=(2, 3, model.nq + model.nv))
    qpos, qvel = index.unpack(states)
    assert qpos.shape == (2, 3, model.nq)
    assert qvel.shape == (2, 3, model.nv)
    assert np.shares_memory(qpos, states)
    np.testing.assert_array_equal(index.pack(qpos, qvel), states)


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda index: index.pose("bal"), "unknown free body 'bal'; valid: ball, robot"),
        (lambda index: index.velocity("link"), "unknown free body 'link'; valid: ball, robot"),
        (
            lambda index: index.joints(("hinge", "knee")),
            "unknown joint 'knee'; valid: hinge, slide",
        ),
        (lambda index: index.joints(("base",)), "unknown joint 'base'; valid: hinge, slide"),
        (lambda index: index.unpack(np.zeros(5)), r"shape \(5,\); needs \(\.\.\., 30\)"),
    ],
)
def test_what_is_not_there_is_an_error_that_names_what_is(index, use, message):
    with pytest.raises(UsageError, match=message):
        use(index)


def test_what_has_no_name_is_counted_by_its_number():
    thing = "<body><freejoint/><geom size='.1'/><body><joint/><geom size='.1'/></body></body>"
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{thing * 3}</worldbody></mujoco>")
    index = StateIndex(model)
    assert index.free_bodies == ("body_1", "body_3", "body_5")
    assert [index.pose(body).start for body in index.free_bodies] == [0, 8, 16]
    assert index.columns["joint_3"] == (15, index.nq + 13)
    assert label(model, "geom", 2) == "geom_2"
