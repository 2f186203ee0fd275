import mujoco
import pytest

from sumo_dist.model.coordinates import coordinates
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task

XML = """<mujoco><worldbody>
<body name="a"><freejoint/><geom size="1"/>
  <body><joint name="turn"/><geom size="1"/>
    <body><joint type="slide"/><geom size="1"/></body>
  </body>
</body>
<body name="b"><joint name="any" type="ball"/><geom size="1"/></body>
</worldbody></mujoco>"""


def test_every_number_of_a_state_has_a_name_and_a_unit():
    names = [f"{name} {unit}" for name, unit in coordinates(mujoco.MjModel.from_xml_string(XML))]
    assert names == [
        *("a.x m", "a.y m", "a.z m", "a.qw 1", "a.qx 1", "a.qy 1", "a.qz 1"),
        *("turn.q rad", "joint_2.q m", "any.qw 1", "any.qx 1", "any.qy 1", "any.qz 1"),
        *("a.vx m/s", "a.vy m/s", "a.vz m/s", "a.wx rad/s", "a.wy rad/s", "a.wz rad/s"),
        *("turn.v rad/s", "joint_2.v m/s", "any.wx rad/s", "any.wy rad/s", "any.wz rad/s"),
    ]


@pytest.mark.parametrize("task", ["spot/upright_chair", "g1/door_open"])
def test_names_are_as_many_as_numbers_and_all_different(task):
    model = compile_model(load_task(task).scene, PLANT)
    found = coordinates(model)
    assert len({name for name, _ in found}) == len(found) == model.nq + model.nv
