import warnings

import mujoco
import numpy as np
import pytest

from sumo_dist.model.scene import PLANNING, PLANT, Scene, SceneObject, compile_model, remarks
from sumo_dist.robots.spot import SPOT

BODIES = """<body name="crate" pos="0 0 .5" euler="30 10 20"><freejoint/>
  <geom type="box" size=".3 .2 .1" density="200"/>
  <geom type="box" size=".3 .2 .1" mass=".3" contype="0" conaffinity="0" group="1"/>
  <geom size=".1" group="4" pos=".2 0 0"/>
  <body name="lid" pos="0 0 .3" euler="0 90 10">
    <joint name="hinge" range="-1 1"/><inertial pos=".1 0 0" mass=".2" diaginertia=".1 .1 .1"/>
    <geom size=".1"/>
  </body>
  <body name="knob" pos=".1 .1 .1"><geom size=".01"/></body>
</body>"""
SETTINGS = (
    "",
    'angle="radian"',
    'eulerseq="zyx"',
    'settotalmass="5"',
    'settotalmass="5" boundmass=".5" boundinertia=".2" inertiafromgeom="true"',
    'settotalmass="5" fusestatic="true" alignfree="true"',
    'inertiafromgeom="true" fusestatic="true"',
    'boundmass=".5" boundinertia=".5"',
    'balanceinertia="true"',
    'inertiafromgeom="true"',
    'inertiagrouprange="0 1"',
    'alignfree="true"',
    'discardvisual="true"',
    'fusestatic="true"',
    'fitaabb="true"',
)
ARRAYS = {
    "nbody": ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat"),
    "ngeom": ("geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_friction", "geom_rgba"),
    "njnt": ("jnt_type", "jnt_pos", "jnt_axis", "jnt_range", "jnt_limited"),
}


def scene(path):
    return Scene(SPOT, (SceneObject("crate", str(path)),))


@pytest.mark.parametrize("compiler", SETTINGS)
def test_settings_act_as_in_the_file_alone(tmp_path, compiler):
    path = tmp_path / "crate.xml"
    path.write_text(f"<mujoco><compiler {compiler}/><worldbody>{BODIES}</worldbody></mujoco>")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # settotalmass is old
        alone = mujoco.MjSpec.from_file(str(path)).compile()
    plant, planning = (compile_model(scene(path), options) for options in (PLANT, PLANNING))
    robot = compile_model(Scene(SPOT), PLANT)
    for size, names in ARRAYS.items():
        world = 1 if size == "nbody" else 0  # the object's come last in the scene
        assert getattr(plant, size) == getattr(robot, size) + getattr(alone, size) - world
        for name in names:
            theirs = getattr(alone, name)[world:]
            ours = getattr(plant, name)[-len(theirs) :]
            np.testing.assert_allclose(ours, theirs, rtol=1e-13, atol=0, err_msg=name)
    np.testing.assert_array_equal(planning.body_mass, plant.body_mass)
    np.testing.assert_array_equal(planning.body_inertia, plant.body_inertia)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ('<option timestep="0.01"/>', None),  # as the scene has it
        ('<option wind="1 0 0" cone="elliptic"/>', "option wind, cone"),
        ('<option><flag gravity="disable"/></option>', "option flag"),
        ('<size memory="9M" nuser_geom="2"/>', "size memory"),
        ("<visual><map znear='.1'/></visual><statistic extent='9'/>", None),
        ("<keyframe><key/><key/></keyframe>", "keyframes"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_a_file_sets_for_a_whole_world_is_left_out(tmp_path, capfd, settings, said):
    path = tmp_path / "crate.xml"
    path.write_text(f"<mujoco>{settings}<worldbody>{BODIES}</worldbody></mujoco>")
    line = f"{path}: left out {said}: these are the scene's to set"
    assert remarks(scene(path)) == ([line] if said else [])
    compile_model(scene(path), PLANNING)
    assert "".join(capfd.readouterr()) == ""


def test_user_data_comes_along(tmp_path):
    path = tmp_path / "crate.xml"
    bodies = BODIES.replace('name="crate"', 'name="crate" user="3 4"')
    path.write_text(f'<mujoco><size nuser_body="2"/><worldbody>{bodies}</worldbody></mujoco>')
    assert compile_model(scene(path), PLANT).body("crate").user.tolist() == [3, 4]
