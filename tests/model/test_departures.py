"""What the lean planning model leaves out, and that nothing else is left out with it."""

from collections import Counter
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model import departures
from sumo_dist.model.departures import DRY, LEAN, SEARCH, SELF, SOLVER
from sumo_dist.model.scene import PLANNING, Scene, SceneObject, compile_model
from sumo_dist.model.variation import Spread, draw, varied
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks import load_task, task_names

FULL = replace(PLANNING, departures=())
WEDGE = "v 0 0 0\nv .4 0 0\nv 0 .4 0\nv 0 0 .4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

# Objects and fixtures of a file's own settings, each the content of an MJCF file.
CRATE = """<worldbody><body name="crate" pos="0 0 .5"><freejoint/>
  <geom type="box" size=".3 .2 .1" density="200" priority="5" friction="1.1 .01 .001" condim="4"/>
  <geom type="box" size=".3 .2 .12" mass="0" contype="0" conaffinity="0" group="1"/>
  <geom size=".15" pos=".25 0 .1" solmix="3" solref=".01 .8" solimp=".8 .9 .01 .4 3" margin=".02"/>
  <body name="lid" pos="0 0 .15"><joint axis="0 1 0" range="-1 1"/>
    <geom type="cylinder" size=".1 .05" friction=".3 .02 .003" condim="6" gap=".01" margin=".03"/>
    <geom type="ellipsoid" size=".1 .2 .05" pos=".1 0 .1" solref="-900 -60" priority="5"/>
  </body></body></worldbody>"""
DOOR = """<worldbody><body name="frame" pos=".5 .4 0"><geom type="box" size=".05 .05 .8"/>
  <body name="leaf" pos="0 -.5 .5"><joint name="hinge" axis="0 0 1" frictionloss="2" damping="1"/>
    <geom type="box" size=".03 .4 .5" mass="8"/>
    <body pos="-.1 0 0"><joint type="slide" axis="0 1 0" range="-.2 .2"/>
      <geom type="capsule" size=".02 .1" mass=".2" contype="4" conaffinity="4"/></body>
  </body></body></worldbody>"""
CHOOSY = """<worldbody><body name="it"><freejoint/>
  <geom name="floor only" type="sphere" size=".2" contype="0" conaffinity="2"/>
  <geom name="all but the floor" type="sphere" size=".25" pos=".1 0 0" contype="0"/>
  <geom name="its own kind" type="sphere" size=".3" pos="-.1 0 0" contype="8" conaffinity="8"/>
</body></worldbody>"""
STATED = """<worldbody><body name="a"><freejoint/><geom name="ga" size=".2" mass="1"/>
  <geom name="gb" size=".2" pos=".2 0 0" mass="1"/>
  <body name="b" pos="0 .2 .1"><joint/><geom name="gc" size=".15" mass="1"/>
    <body name="c" pos="0 .1 .1"><joint/><geom name="gd" size=".15" mass="1" pos=".1 0 0"/>
      <geom size=".15" mass="1"/></body></body></body></worldbody>
  <contact><exclude body1="a" body2="c"/>
    <pair geom1="gd" geom2="ga" friction=".2 .3 .01 .02 .03" condim="6" margin=".01"/></contact>"""
MESH = """<asset><mesh name="wedge" file="wedge.obj"/></asset><worldbody><body><freejoint/>
  <geom type="mesh" mesh="wedge"/><geom type="mesh" mesh="wedge" pos=".3 .1 0" euler="90 20 0"/>
</body></worldbody>"""
HILL = """<asset><hfield name="hill" nrow="3" ncol="3" size="1 1 .5 .1"
  elevation="0 .2 .4 .1 .9 .2 .3 .1 .5"/></asset>
  <worldbody><geom type="hfield" hfield="hill" pos=".3 0 -.1"/></worldbody>"""
CARRIED = """<worldbody><body name="tray" mocap="true" pos=".4 .2 .3">
  <geom type="box" size=".3 .3 .02"/></body></worldbody>"""
URDF = """<robot name="cart"><link name="l"><inertial><mass value="3"/>
  <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size=".2 .3 .4"/></geometry></collision>
  <collision><origin xyz=".1 0 .1"/><geometry><sphere radius=".2"/></geometry></collision>
</link></robot>"""
OBJECTS = {"crate": CRATE, "choosy": CHOOSY, "stated": STATED, "mesh": MESH, "urdf": URDF}
FIXTURES = {"door": DOOR, "hill": HILL, "carried": CARRIED}
STICKY = CRATE.replace('condim="4"', 'adhesion="3"')


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A function from a name and the content of a model file to what is in a scene of it."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "wedge.obj").write_text(WEDGE)

    def write(name, content):
        urdf = content.startswith("<robot")
        path = folder / f"{name}.{'urdf' if urdf else 'xml'}"
        path.write_text(content if urdf else f"<mujoco>{content}</mujoco>")
        return SceneObject(name, str(path))

    return write


@pytest.fixture(scope="module", params=[SPOT, G1], ids=lambda robot: robot.name)
def crowded(request, files):
    """A robot among two of each object and one of each fixture."""
    objects = [files(name + twin, text) for name, text in OBJECTS.items() for twin in ("", "2")]
    fixtures = [files(name, text) for name, text in FIXTURES.items()]
    return Scene(request.param, tuple(objects), tuple(fixtures))


def contacts(model, data):
    """What touches, with all numbers of it, but for what is within the robot: a Counter."""
    robot = model.body_rootid[model.jnt_bodyid[model.actuator_trnid[0, 0]]]
    found = []
    for contact in data.contact:
        if (model.body_rootid[model.geom_bodyid[contact.geom]] != robot).any():
            numbers = (contact.dist, contact.includemargin, *contact.pos, *contact.frame)
            numbers += (*contact.friction, *contact.solref, *contact.solreffriction)
            numbers += (*contact.solimp, *contact.surfacevel, contact.adhesion)
            rounded = tuple(float(f"{number:.12g}") for number in numbers)
            found.append((tuple(contact.geom), int(contact.dim), contact.exclude, rounded))
    return Counter(found)


def assert_same_contacts(scene, options, states, least):
    """Both models touch the same in all of these states, and something does."""
    full, other = (compile_model(scene, each) for each in (FULL, options))
    data, total = [mujoco.MjData(model) for model in (full, other)], 0
    for qpos in states(full):
        for model, its in zip((full, other), data, strict=True):
            its.qpos[:] = qpos
            mujoco.mj_fwdPosition(model, its)
        expected = contacts(full, data[0])
        assert contacts(other, data[1]) == expected
        total += expected.total()
    assert total >= least
    return full, other


def scattered(count, seed=0):
    """States in which whatever moves is somewhere in a cubic metre, as it may be."""

    def states(model):
        rng = np.random.default_rng(seed)
        for _ in range(count):
            qpos = model.qpos0 + rng.normal(0.0, 0.3, model.nq)
            for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
                first = model.jnt_qposadr[joint]
                qpos[first : first + 3] = rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.8))
                qpos[first + 3 : first + 7] = rng.normal(size=4)
            mujoco.mj_normalizeQuat(model, qpos)
            yield qpos

    return states


@pytest.mark.parametrize("name", task_names())
def test_a_tasks_contacts_are_those_of_the_full_model(name):
    _, lean = assert_same_contacts(load_task(name).scene, PLANNING, scattered(40), least=40)
    assert lean.npair > 0
    assert not lean.body_contype.any()


def test_contacts_of_any_files_are_those_of_the_full_model(crowded, monkeypatch):
    monkeypatch.setattr(departures, "PAIRS", 10_000)
    full, lean = assert_same_contacts(crowded, PLANNING, scattered(60), least=3000)
    assert lean.npair > full.npair == 2  # each twin states one contact itself


@pytest.mark.parametrize("alone", LEAN)
def test_each_departure_alone_leaves_those_contacts(crowded, alone):
    assert_same_contacts(crowded, replace(FULL, departures=(alone,)), scattered(10, 1), least=300)


def test_many_geoms_and_sticky_ones_are_left_to_mujocos_search(crowded, files, monkeypatch):
    _, lean = assert_same_contacts(crowded, PLANNING, scattered(10, 2), least=300)
    assert lean.npair == 2
    sticky = Scene(SPOT, (files("sticky", STICKY),))
    _, lean = assert_same_contacts(sticky, PLANNING, scattered(60), least=60)
    assert lean.npair == 0
    monkeypatch.setattr(departures, "PAIRS", 54)
    _, lean = assert_same_contacts(load_task("spot/move_box").scene, PLANNING, scattered(9), 9)
    assert lean.npair == 0


@pytest.mark.parametrize("robot", [SPOT, G1], ids=lambda robot: robot.name)
def test_a_lean_robot_passes_through_itself(robot):
    box = SceneObject("box", "objects/box.xml")
    full, lean = (compile_model(Scene(robot, (box,)), options) for options in (FULL, PLANNING))
    touched = 0
    for qpos in scattered(60)(full):
        for model in (full, lean):
            data = mujoco.MjData(model)
            data.qpos[:] = qpos
            mujoco.mj_fwdPosition(model, data)
            within = data.ncon - contacts(model, data).total()
            touched += within
            assert model is full or within == 0
    assert touched > 15


def test_a_list_of_contacts_changes_no_bit_of_a_step():
    scene = load_task("spot/move_box").scene
    models = [compile_model(scene, replace(FULL, departures=d)) for d in ((), (SEARCH,))]
    steps = [mujoco.MjData(model) for model in models]
    for _ in range(100):
        for model, data in zip(models, steps, strict=True):
            data.ctrl[:] = 0.3
            mujoco.mj_step(model, data)
    assert steps[0].ncon > 0
    np.testing.assert_array_equal(steps[0].qpos, steps[1].qpos)


def test_only_the_robots_joints_lose_their_friction(crowded):
    full, other = (compile_model(crowded, replace(FULL, departures=d)) for d in ((), (DRY,)))
    robot = full.body_rootid[full.dof_bodyid] == full.body(crowded.robot.base).id
    dry = full.dof_frictionloss
    assert not other.dof_frictionloss[robot].any()
    np.testing.assert_array_equal(other.dof_frictionloss[~robot], dry[~robot])
    assert (other.dof_frictionloss > 0).sum() == 1  # the door's hinge
    np.testing.assert_array_equal(other.dof_damping, full.dof_damping + robot * dry / 2.0)


def test_the_rest_of_the_model_stays(crowded, monkeypatch):
    monkeypatch.setattr(departures, "PAIRS", 10_000)
    full, lean = (compile_model(crowded, options) for options in (FULL, PLANNING))
    for name in (
        *("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat"),
        *("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_friction", "geom_bodyid"),
        *("jnt_type", "jnt_axis", "jnt_range", "dof_armature", "actuator_gainprm", "qpos0"),
    ):
        np.testing.assert_array_equal(getattr(lean, name), getattr(full, name), name)
    assert lean.opt.timestep == full.opt.timestep
    assert lean.opt.tolerance == full.opt.tolerance


def test_friction_of_listed_contacts_varies_with_the_geoms(crowded, monkeypatch):
    monkeypatch.setattr(departures, "PAIRS", 10_000)
    full, lean = (compile_model(crowded, options) for options in (FULL, PLANNING))
    variation = draw(full, Spread(friction=0.6, mass=0.2), np.random.default_rng(0))
    before, total = varied(full, variation), 0
    after = varied(lean, variation)
    for qpos in scattered(10, 3)(full):
        found = []
        for model in (before, after):
            data = mujoco.MjData(model)
            data.qpos[:] = qpos
            mujoco.mj_fwdPosition(model, data)
            found.append(contacts(model, data))
        assert found[0] == found[1]
        total += found[0].total()
    assert total > 300


def test_the_solver_of_a_lean_model_starts_anew():
    bits = mujoco.mjtDisableBit
    for scene, sparse in ((Scene(SPOT), False), (load_task("g1/box_push").scene, True)):
        model = compile_model(scene, replace(FULL, departures=(SOLVER,)))
        assert model.opt.disableflags & bits.mjDSBL_WARMSTART
        assert model.opt.disableflags & bits.mjDSBL_ISLAND
        assert (model.opt.jacobian == mujoco.mjtJacobian.mjJAC_SPARSE) == sparse


def test_an_unknown_departure_is_named():
    with pytest.raises(UsageError, match="unknown departure 'gravity'; valid: contact search, dry"):
        compile_model(Scene(SPOT), replace(FULL, departures=(SELF, "gravity")))
