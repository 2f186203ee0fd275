import mujoco
import numpy as np
import pytest

from sumo_dist.view.ahead import TWIN
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.rrd_file import RrdFile
from sumo_dist.view.scene import SceneLog, left_out
from sumo_dist.view.shapes import TWIN_FACES

XML = """
<mujoco>
  <asset>
    <material name="paint" rgba="0.2 0.4 0.6 1"/>
    <mesh name="tetra" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
  </asset>
  <worldbody>
    <geom name="ground" type="plane" size="3 2 0.1"/>
    <body name="chain/first" pos="0 0 1">
      <freejoint/>
      <geom name="ball" type="sphere" size="0.1" rgba="1 0 0 0.5"/>
      <geom name="hidden" type="box" size="1 1 1" group="3"/>
      <geom name="rod" type="capsule" size="0.02 0.3" pos="0.5 0 0" euler="90 0 0"
        material="paint"/>
      <body name="second" pos="0.3 0 0">
        <joint type="hinge" axis="0 0 1"/>
        <geom name="egg" type="ellipsoid" size="0.1 0.2 0.3" group="2"/>
        <geom name="can" type="cylinder" size="0.1 0.2"/>
        <geom name="crate" type="box" size="0.1 0.2 0.3"/>
        <geom name="solid" type="mesh" mesh="tetra"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(XML)


@pytest.fixture
def logged(model, tmp_path, read_rrd):
    """Seven ticks of tumbling in chunks of three: the entities, and the poses MuJoCo computed."""
    data = mujoco.MjData(model)
    data.qvel[:] = [1.0, 0.5, 0.0, 1.0, 2.0, 3.0, 4.0]
    poses = []
    with Outputs("test", RrdFile(tmp_path / "run.rrd", pytest.fail)) as out:
        scene = SceneLog(out, model, chunk_ticks=3)
        for tick in range(7):
            mujoco.mj_step(model, data, nstep=10)
            mujoco.mj_kinematics(model, data)
            scene.add(tick, data)
            poses.append({name: data.body(name).xpos.copy() for name in ("chain/first", "second")})
            quats = {name: data.body(name).xquat.copy() for name in ("chain/first", "second")}
        scene.flush()
    return read_rrd(tmp_path / "run.rrd"), poses, quats


def test_poses_are_those_of_mujoco_at_every_tick(logged):
    rrd, poses, quats = logged
    sent = rrd.timed["/world/poses"]
    assert len(sent["sim_time"]) == 7 * 2
    rows = {}
    for row, time in enumerate(sent["sim_time"]):
        tick = round(time.total_seconds() / 0.02)
        rows[tick, sent["Transform3D:child_frame"][row][0]] = row
    for tick, bodies in enumerate(poses):
        for name, pos in bodies.items():
            translation = sent["Transform3D:translation"][rows[tick, name]][0]
            assert np.allclose(translation, pos, atol=1e-6)
    for name, quat in quats.items():
        assert np.allclose(
            sent["Transform3D:quaternion"][rows[6, name]][0], np.roll(quat, -1), atol=1e-6
        )


def test_only_what_is_seen_is_drawn_and_in_its_bodys_frame(logged):
    entities = logged[0].static
    drawn = {e.split("/")[-1] for e in entities if e.startswith(("/world/bodies", "/world/fixed"))}
    assert drawn == {"ground", "ball", "rod", "egg", "can", "crate", "solid"}
    assert entities["/world/bodies/second/can"]["CoordinateFrame:frame"] == [["second"]]
    assert entities[r"/world/bodies/chain\/first/ball"]["CoordinateFrame:frame"] == [
        ["chain/first"]
    ]
    assert "CoordinateFrame:frame" not in entities["/world/fixed/ground"]


def test_shapes_have_mujocos_sizes(logged):
    entities = logged[0].static
    second = {n: entities[f"/world/bodies/second/{n}"] for n in ("egg", "can", "crate", "solid")}
    assert np.allclose(second["egg"]["Ellipsoids3D:half_sizes"][0], [[0.1, 0.2, 0.3]])
    assert np.allclose(second["can"]["Cylinders3D:lengths"][0], [0.4])
    assert np.allclose(second["can"]["Cylinders3D:radii"][0], [0.1])
    assert np.allclose(second["crate"]["Boxes3D:half_sizes"][0], [[0.1, 0.2, 0.3]])
    assert len(second["solid"]["Mesh3D:triangle_indices"][0]) == 4
    solid = second["solid"]
    corners = np.array(solid["Mesh3D:vertex_positions"][0])[solid["Mesh3D:triangle_indices"][0]]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    assert sorted(sides.ravel()) == pytest.approx([1.0] * 6 + [np.sqrt(2.0)] * 6)
    assert len(solid["Mesh3D:vertex_normals"][0]) == len(solid["Mesh3D:vertex_positions"][0])


def test_a_capsule_starts_half_its_length_before_the_geoms_centre(logged):
    rod = logged[0].static[r"/world/bodies/chain\/first/rod"]
    assert np.allclose(rod["Capsules3D:lengths"][0], [0.6])
    # euler 90 about x turns the geom's z into the body's -y.
    assert np.allclose(rod["InstancePoses3D:translations"][0], [[0.5, 0.3, 0.0]], atol=1e-6)


def test_a_geoms_own_colour_comes_before_its_materials(logged):
    entities = logged[0].static
    ball = entities[r"/world/bodies/chain\/first/ball"]["Ellipsoids3D:colors"][0][0]
    rod = entities[r"/world/bodies/chain\/first/rod"]["Capsules3D:colors"][0][0]
    assert ball == 0xFF000080
    assert rod == 0x336699FF


@pytest.fixture
def drawn(tmp_path, read_rrd):
    """A function that draws a world at rest: its model, its static entities, its first poses."""

    def drawn(world, asset=""):
        text = f"<mujoco><asset>{asset}</asset><worldbody>{world}</worldbody></mujoco>"
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        with Outputs("test", RrdFile(tmp_path / "run.rrd", pytest.fail)) as out:
            for twin in (None, TWIN):
                SceneLog(out, model, 1, twin).add(0, data)
        rrd = read_rrd(tmp_path / "run.rrd")
        return model, rrd.static, rrd.timed.get("/world/poses")

    return drawn


def test_bodies_without_a_name_have_frames_of_their_own(drawn):
    drawer = '<body pos="{} 0 0"><joint/><geom size=".1"/></body>'
    _, entities, poses = drawn(f"<body>{drawer.format(1)}{drawer.format(2)}</body>")
    frames = dict(
        zip(
            (row[0] for row in poses["Transform3D:child_frame"]),
            (row[0][0] for row in poses["Transform3D:translation"]),
            strict=True,
        )
    )
    assert frames == {"body_2": 1.0, "body_3": 2.0}
    for geom, body in (("geom_0", "body_2"), ("geom_1", "body_3")):
        entity = entities[f"/world/bodies/{body}/{geom}"]
        assert entity["CoordinateFrame:frame"] == [[body]]


def test_a_body_of_hidden_geoms_alone_is_drawn_by_them(drawn):
    both = '<geom name="{}" size=".1" group="{}"/>'
    crate = f'<body name="crate">{both.format("solid", 3)}</body>'
    robot = f'<body name="robot">{both.format("hidden", 3)}{both.format("seen", 2)}</body>'
    _, entities, _ = drawn(crate + robot)
    geoms = {e.split("/")[-1] for e in entities if e.startswith("/world/bodies")}
    assert geoms == {"solid", "seen"}


def height_field(nrow, ncol):
    heights = " ".join(f"{(7 * i) % 11 / 10}" for i in range(nrow * ncol))
    return (
        f'<hfield name="hills" nrow="{nrow}" ncol="{ncol}" size="3 2 .5 .1" elevation="{heights}"/>'
    )


def test_a_height_field_is_drawn_where_it_touches(drawn):
    model, entities, _ = drawn(
        '<geom name="terrain" type="hfield" hfield="hills" pos="1 2 3"/>', height_field(4, 6)
    )
    terrain = entities["/world/fixed/terrain"]
    points = np.array(terrain["Mesh3D:vertex_positions"][0])
    corners = points[np.array(terrain["Mesh3D:triangle_indices"][0])]  # (triangles, 3, xyz)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inside = corners.mean(axis=1) + terrain["InstancePoses3D:translations"][0]
    for x, y, z in inside:
        above = np.array([x, y, 10.0])
        depth = mujoco.mj_ray(
            model, data, above, np.array([0, 0, -1.0]), None, 1, -1, np.array([-1], np.int32)
        )
        assert 10.0 - depth == pytest.approx(z, abs=1e-5)
    assert len(corners) == 2 * 3 * 5
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()  # seen from above
    assert np.ptp(points, axis=0) == pytest.approx([6, 4, 0.5])


def test_a_large_height_field_is_drawn_in_fewer_lines(drawn):
    _, entities, _ = drawn(
        '<geom name="terrain" type="hfield" hfield="hills"/>', height_field(300, 20)
    )
    points = np.array(entities["/world/fixed/terrain"]["Mesh3D:vertex_positions"][0])
    assert len(points) == 100 * 20
    assert np.ptp(points[:, :2], axis=0) == pytest.approx([6, 4])


def test_names_that_clash_have_places_of_their_own(drawn):
    named = '<body name="body_2"><joint/><geom name="geom_1" size=".1"/></body>'
    unnamed = '<body pos="1 0 0"><joint/><geom size=".1"/></body>'
    _, entities, poses = drawn(named + unnamed)
    frames = {row[0] for row in poses["Transform3D:child_frame"]}
    assert len(frames) == 2
    assert len([e for e in entities if e.startswith("/world/bodies")]) == 2


def test_what_moves_has_a_twin_in_frames_of_its_own(drawn):
    hinged = '<body name="door"><joint/><geom name="leaf" type="box" size=".1 .2 .3"/></body>'
    fixed = '<body name="frame"><geom name="post" type="box" size=".1 .1 .1"/></body>'
    free = '<body name="crate"><freejoint/><geom name="all" size=".1" group="3"/></body>'
    _, entities, _ = drawn(hinged + fixed + free)
    twins = {e.split("/")[-1]: e for e in entities if e.startswith("/world/plan/twin/bodies")}
    assert twins.keys() == {"leaf", "all"}
    assert entities[twins["leaf"]]["CoordinateFrame:frame"] == [["plan of door"]]
    assert np.allclose(entities[twins["leaf"]]["Boxes3D:half_sizes"][0], [[0.1, 0.2, 0.3]])


@pytest.mark.parametrize("params", [2, 4])
def test_the_twin_of_a_large_mesh_is_the_box_around_it(drawn, params):
    ball = f'<mesh name="ball" builtin="sphere" params="{params}" scale=".3 .3 .3"/>'
    model, entities, _ = drawn(
        '<body><freejoint/><geom name="ball" type="mesh" mesh="ball"/></body>', ball
    )
    [twin] = [e for name, e in entities.items() if name.startswith("/world/plan/twin/bodies")]
    assert ("Boxes3D:half_sizes" in twin) == (model.mesh_facenum[0] > TWIN_FACES)
    if params == 4:
        assert np.allclose(twin["Boxes3D:half_sizes"][0], [[0.3] * 3], atol=0.01)


TEXTURE = """
<texture name="two" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="8" height="8"/>
<material name="two" texture="two"/>
<mesh name="leaf" vertex="0 0 0 1 0 0 0 1 0 0 0 .1" texcoord="0 0 1 0 0 1 1 1"
  face="0 1 2 0 2 3 0 3 1 1 3 2"/>
"""


def test_a_texture_is_drawn_on_a_mesh_and_tints_what_has_no_place_for_it(drawn):
    world = """
    <geom name="leaf" type="mesh" mesh="leaf" material="two"/>
    <geom name="box" type="box" size=".1 .1 .1" material="two"/>"""
    _, entities, _ = drawn(world, TEXTURE)
    leaf, box = (entities[f"/world/fixed/{name}"] for name in ("leaf", "box"))
    assert len(leaf["Mesh3D:albedo_texture_buffer"][0][0]) == 8 * 8 * 3
    assert len(leaf["Mesh3D:vertex_texcoords"][0]) == len(leaf["Mesh3D:vertex_positions"][0])
    assert box["Boxes3D:colors"][0][0] == 0x800080FF  # half red, half blue


def test_what_is_clear_is_not_drawn_but_where_nothing_else_is(drawn):
    shell = '<geom name="shell" size=".2" rgba="1 1 1 0"/>'
    both = f'<body>{shell}<geom name="core" size=".1" rgba="1 0 0 .5"/></body>'
    alone = '<body><geom name="ghost" size=".1" rgba="0 1 0 0"/></body>'
    _, entities, _ = drawn(both + alone)
    drawn_ = {e.split("/")[-1]: e for e in entities if e.startswith("/world/bodies")}
    assert drawn_.keys() == {"core", "ghost"}
    assert entities[drawn_["core"]]["Ellipsoids3D:colors"][0][0] == 0xFF000080
    assert entities[drawn_["ghost"]]["Ellipsoids3D:colors"][0][0] == 0x00FF00FF


def test_a_plane_of_ones_own_has_its_colour(drawn):
    _, entities, _ = drawn('<geom name="ramp" type="plane" size="1 1 .1" rgba="1 0 0 1"/>')
    assert entities["/world/fixed/ramp"]["Boxes3D:colors"][0][0] == 0xFF0000FF


def test_what_is_left_out_is_named(drawn):
    hinge = '<body name="b{0}"><joint name="j{0}"/><geom size=".1"/><site name="s{0}"/></body>'
    text = """<mujoco><worldbody>{}{}</worldbody><tendon>
    <spatial><site site="s0"/><site site="s1"/></spatial>
    <fixed><joint joint="j0" coef="1"/></fixed></tendon></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text.format(hinge.format(0), hinge.format(1)))
    assert left_out(model) == "spatial tendon (1)"
    assert not left_out(drawn('<geom size=".1"/>')[0])
