"""The eye goes where nothing hides the robot, and else stays where it is usual."""

import mujoco
import numpy as np
import pytest

from sumo_dist.view.eye import Shot, clearest_azimuth, direction

SCENE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    {wall}
    <body name="robot" pos="0 0 0.5">
      <freejoint/>
      <geom type="box" size="0.2 0.1 0.1"/>
      <body name="arm" pos="0.2 0 0.1"><geom type="sphere" size="0.05"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def side(wall, preferred=0.0):
    model = mujoco.MjModel.from_xml_string(SCENE.format(wall=wall))
    shot = Shot(model.qpos0, np.array([0.0, 0.0, 0.5]), 3.0)
    return clearest_azimuth(model, "robot", [shot], 20.0, preferred)


@pytest.mark.parametrize("preferred", [0.0, -55.0, 200.0])
def test_with_nothing_in_the_way_it_is_the_preferred_side(preferred):
    assert side("", preferred) == preferred


def test_a_wall_before_the_eye_is_walked_around():
    wall = '<geom type="box" size="0.05 1 1" pos="1 0 1"/>'
    around = side(wall)
    assert 30.0 <= abs(around) <= 90.0
    assert side(wall, 180.0) == 180.0


def test_what_is_not_drawn_hides_nothing():
    assert side('<geom type="box" size="0.05 1 1" pos="1 0 1" group="3"/>') == 0.0


def test_directions_are_of_length_one_and_go_up():
    assert direction(90.0, 0.0) == pytest.approx([0.0, 1.0, 0.0])
    assert direction(0.0, 90.0) == pytest.approx([0.0, 0.0, 1.0])
    assert np.linalg.norm(direction(33.0, 21.0)) == pytest.approx(1.0)
