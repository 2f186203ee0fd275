import mujoco
import numpy as np
import pytest

from sumo_dist.model.visible import drawn, height_field, rgba

MODEL = """
<mujoco>
  <asset>
    <material name="red" rgba="1 0 0 1"/>
    <hfield name="hill" nrow="5" ncol="9" size="2 1 0.5 0.1"/>
  </asset>
  <worldbody>
    <geom name="hill" type="hfield" hfield="hill"/>
    <body name="both">
      <geom name="seen" size="0.1" material="red"/>
      <geom name="solid" size="0.1" group="3"/>
      <geom name="clear" size="0.1" rgba="1 1 1 0"/>
    </body>
    <body name="hidden" pos="1 0 0">
      <geom name="only" size="0.1" group="3" rgba="0 1 0 1" material="red"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(MODEL)


def test_what_would_not_be_seen_at_all_is_drawn(model):
    names = {model.geom(i).name for i in np.flatnonzero(drawn(model))}
    assert names == {"hill", "seen", "only"}


def test_a_geoms_own_colour_goes_before_its_materials(model):
    assert rgba(model, model.geom("seen").id).tolist() == [1, 0, 0, 1]
    assert rgba(model, model.geom("only").id).tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize(("lines", "shape"), [(100, (5, 9, 3)), (3, (3, 3, 3))])
def test_a_height_field_reaches_its_edges_however_thin(model, lines, shape):
    points, triangles = height_field(model, model.geom("hill").id, lines)
    assert points.shape == shape
    assert (points[0, 0, :2].tolist(), points[-1, -1, :2].tolist()) == ([-2, -1], [2, 1])
    assert len(triangles) == 2 * (shape[0] - 1) * (shape[1] - 1)
    assert triangles.max() == shape[0] * shape[1] - 1
