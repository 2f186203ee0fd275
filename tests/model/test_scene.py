from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANNING, PLANT, Scene, SceneObject, compile_model, remarks
from sumo_dist.model.settle import settled_stand
from sumo_dist.robots.spot import SPOT

BOX = SceneObject("box", "objects/box.xml")


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return compile_model(Scene(SPOT, (BOX,)), PLANT)


def model_file(folder, text: str) -> str:
    path = folder / "thing.xml"
    options = "<option timestep='0.5' density='9'/><visual><map znear='0.1'/></visual>"
    path.write_text(f"<mujoco>{options}{text}</mujoco>")
    return str(path)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("options", "timestep", "density"),
    [(PLANT, 0.01, 1), (replace(PLANNING, departures=()), 0.02, 0)],
)
def test_the_scenes_options_win_over_the_files(tmp_path, options, timestep, density):
    ball = model_file(tmp_path, "<worldbody><body><geom size='0.1'/></body></worldbody>")
    compiled = compile_model(Scene(SPOT, (SceneObject("ball", ball),)), options).opt
    assert (compiled.timestep, compiled.density, compiled.viscosity) == (timestep, density, 0)
    assert compiled.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert compiled.solver == mujoco.mjtSolver.mjSOL_NEWTON
    assert compiled.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    assert (compiled.iterations, compiled.ls_iterations) == (100, 50)
    assert (compiled.tolerance, compiled.impratio) == (1e-8, 1.0)
    assert compiled.disableflags == mujoco.mjtDisableBit.mjDSBL_AUTORESET
    assert compiled.enableflags == 0
    np.testing.assert_array_equal(compiled.gravity, [0, 0, -9.81])


def test_a_diverged_state_is_not_reset(model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where MuJoCo logs its warning
    data = mujoco.MjData(model)
    data.qvel[:] = np.nan
    mujoco.mj_step(model, data)
    assert not np.isfinite(data.qpos).all()


def test_the_box(model):
    box = model.body("box")
    assert box.mass == 1.5
    np.testing.assert_array_equal(box.inertia, [0.1445] * 3)
    np.testing.assert_array_equal(box.ipos, [0, 0, 0])
    np.testing.assert_array_equal(model.geom("box/collision").size, [0.254] * 3)
    np.testing.assert_array_equal(model.site("box/site_object").pos, [0, 0, 0])
    assert model.joint("box_joint").qposadr == 26


def test_objects_follow_the_robot_in_scene_order_and_one_file_can_stand_twice():
    two = (SceneObject("left", BOX.mjcf), SceneObject("right", BOX.mjcf))
    model = compile_model(Scene(SPOT, two), PLANT)
    index = StateIndex(model)
    assert index.free_bodies == ("body", "left", "right")
    assert index.pose("left").start == 26
    assert index.pose("right").start == 33
    for name in ("left", "right"):
        assert model.joint(f"{name}_joint").bodyid[0] == model.body(name).id
        assert model.site(f"{name}/site_object").bodyid[0] == model.body(name).id


def contact_friction(model: mujoco.MjModel, qpos: np.ndarray, first: str, second: str) -> float:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    pair = {model.geom(first).id, model.geom(second).id}
    touching = [contact for contact in data.contact if set(contact.geom) == pair]
    assert touching, f"{first} does not touch {second}"
    return touching[0].friction[0]


@pytest.mark.parametrize("floor", [0.7, 1.0])
def test_which_friction_acts(floor):
    model = compile_model(Scene(SPOT, (BOX,), floor_friction=floor), PLANT)
    qpos = np.concatenate([settled_stand(SPOT), [0.55, 0.0, 0.2535, 1, 0, 0, 0]])
    qpos[2] -= 1e-4  # feet just in the floor, and the head in the box
    friction = contact_friction(model, qpos, "front_left_foot_collision", "floor/ground")
    assert friction == floor
    assert contact_friction(model, qpos, "box/collision", "floor/ground") == floor
    assert contact_friction(model, qpos, "body_collision", "box/collision") == 0.15


def test_the_box_rests_at_half_its_height(model):
    data = mujoco.MjData(model)
    pose = StateIndex(model).pose("box")
    data.qpos[pose] = [3.0, 0.0, 0.26, 1, 0, 0, 0]
    mujoco.mj_step(model, data, 200)
    assert data.qpos[pose][2] == pytest.approx(0.254, abs=1e-3)


def test_a_fixture_does_not_move(tmp_path):
    wall = model_file(
        tmp_path, "<worldbody><body name='b' pos='2 0 1'><geom size='0.1'/></body></worldbody>"
    )
    model = compile_model(Scene(SPOT, (BOX,), (SceneObject("wall", wall),)), PLANT)
    assert model.nq == 33
    np.testing.assert_array_equal(model.body("wall/b").pos, [2, 0, 1])


def test_what_is_only_seen_changes_no_bit_of_the_physics():
    ends = []
    for visuals in (False, True):
        model = compile_model(Scene(SPOT, (BOX,)), replace(PLANT, visuals=visuals))
        data = mujoco.MjData(model)
        data.qpos[:] = np.concatenate([settled_stand(SPOT), [0.7, 0.0, 0.254, 1, 0, 0, 0]])
        data.ctrl[:] = SPOT.stand
        mujoco.mj_step(model, data, 100)
        ends.append((model.ngeom, data.qpos.copy()))
    assert ends[0][0] == 29  # what touches: the robot's 27, the box, the floor
    assert ends[1][0] > ends[0][0]
    np.testing.assert_array_equal(ends[0][1], ends[1][1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<worldbody><bdy/></worldbody>", "thing.xml is not a valid MuJoCo model: XML Error"),
        ("<worldbody><body><freejoint/></body></worldbody>", "thing.xml .* mass and inertia"),
        ("<worldbody/>", "thing.xml has no body that could be an object"),
        ("<worldbody><body><joint/><geom size='1'/></body></worldbody>", "a free joint or none"),
        ("<worldbody>", "thing.xml is not a valid MuJoCo model"),
    ],
)
def test_a_broken_model_is_one_line_that_names_the_file(tmp_path, text, message):
    scene = Scene(SPOT, (SceneObject("thing", model_file(tmp_path, text)),))
    with pytest.raises(UsageError, match=message) as error:
        compile_model(scene, PLANT)
    assert "\n" not in str(error.value)


def test_a_missing_model_names_what_there_is():
    scene = Scene(SPOT, (SceneObject("box", "objects/bx.xml"),))
    with pytest.raises(UsageError, match=r"unknown model file 'objects/bx.xml', .*objects/box.xml"):
        compile_model(scene, PLANT)


def test_two_things_of_one_name_are_an_error():
    with pytest.raises(UsageError, match=r"distinct names, got .'box'. twice"):
        Scene(SPOT, (BOX, SceneObject("box", BOX.mjcf)))


@pytest.mark.parametrize("name", ["floor", "world", ""])
def test_names_that_the_scene_needs_for_itself(name):
    with pytest.raises(UsageError, match=f"no object or fixture can be called '{name}': "):
        Scene(SPOT, (SceneObject(name, BOX.mjcf),))


def test_a_thing_named_as_a_part_of_the_robot_is_an_error():
    with pytest.raises(UsageError, match="'arm_link_sh0' is a body of robot 'spot'"):
        compile_model(Scene(SPOT, (SceneObject("arm_link_sh0", BOX.mjcf),)), PLANT)


CHEST = """<worldbody>
  <geom name="ground" type="plane" size="1 1 1"/>
  <camera name="eye" mode="targetbody" target="chest" pos="0 3 1"/>
  <light name="sun" mode="targetbody" target="chest"/>
  <body name="chest" pos="0 0 .5">
    <freejoint name="free"/><geom name="side" type="box" size=".3 .2 .1" mass="4"/>
    <body name="lid"><joint name="hinge"/><geom size=".1"/>
      <light name="lamp" mode="targetbodycom" target="chest"/>
    </body>
  </body>
</worldbody>
<contact>
  <exclude body1="chest" body2="lid"/>
  <pair geom1="ground" geom2="side" friction="2 2 1 1 1"/>
</contact>
<sensor>
  <framepos name="to root" objtype="body" objname="lid" reftype="xbody" refname="chest"/>
  <subtreecom name="of root" body="chest"/>
  <distance name="to floor" geom1="side" geom2="ground"/>
</sensor>
<equality><weld name="held" body1="chest" active="false"/></equality>
<custom><tuple name="both">
  <element objtype="body" objname="chest"/><element objtype="joint" objname="free"/>
</tuple></custom>
<deformable><skin name="cover" vertex="0 0 0 1 0 0 0 1 0" face="0 1 2">
  <bone body="chest" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2" vertweight="1 1 1"/>
</skin></deformable>"""


def test_what_refers_to_the_root_the_free_joint_and_the_files_own_floor_still_does(tmp_path):
    scene = Scene(SPOT, (SceneObject("box", model_file(tmp_path, CHEST)),))
    model = compile_model(scene, PLANT)
    root, lid, free = model.body("box").id, model.body("box/lid").id, model.joint("box_joint").id
    side, floor = model.geom("box/side").id, model.geom("floor/ground").id
    assert model.cam("box/eye").targetbodyid == root
    assert model.light("box/lamp").targetbodyid == root
    assert (root << 16) + lid in model.exclude_signature
    assert {int(model.pair_geom1[0]), int(model.pair_geom2[0])} == {side, floor}
    to_root, of_root, to_floor = (
        model.sensor(f"box/{name}") for name in ("to root", "of root", "to floor")
    )
    assert (to_root.objid, to_root.refid) == (lid, root)
    assert of_root.objid == root
    assert (to_floor.objid, to_floor.refid) == (side, floor)
    assert model.eq("box/held").obj1id == root
    assert model.tuple("box/both").objid.tolist() == [root, free]
    assert model.skin_bonebodyid.tolist() == [root]
    assert np.count_nonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) == 1


def test_what_the_files_bring_along_is_a_line_each(tmp_path):
    chest = model_file(tmp_path, CHEST)
    scene = Scene(SPOT, (SceneObject("chest", chest), BOX), (SceneObject("hall", chest),))
    first, second = remarks(scene)  # nothing of ours
    for line in (first, second):
        assert line.startswith(f"{chest}: ")
        assert "left out option timestep, density: these are the scene's to set" in line
        assert "left out geom 'ground': the scene has a floor" in line
        assert "left out light 'sun': the scene has lights" in line


@pytest.mark.parametrize("options", [PLANT, PLANNING])
def test_several_bodies_without_a_free_joint_move_as_one(tmp_path, options):
    desk = """<worldbody><geom type="plane" size="1 1 1"/><geom size=".1" pos="0 0 1"/>
      <body name="left" pos="0 1 0"><geom size=".1"/></body>
      <body name="right"><geom size=".2"/><body name="drawer"><joint type="slide"/>
      <geom size=".1"/></body></body></worldbody>"""
    file = model_file(tmp_path, desk)
    model = compile_model(Scene(SPOT, (SceneObject("desk", file),)), options)
    index = StateIndex(model)
    assert index.free_bodies == ("body", "desk")
    assert "desk/joint_0" in index.columns
    alone = mujoco.MjModel.from_xml_path(file)
    assert model.body("desk").subtreemass == pytest.approx(
        alone.body_subtreemass[0] + 4 / 3 * np.pi * 0.1**3 * 1000
    )
