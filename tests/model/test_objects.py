"""The manipulated objects: how they weigh, rest, slide, roll and stack, and what a step costs.

Heights and angles are those of the released models; where our shapes are simpler than theirs, the
tolerance says by how much.
"""

import time
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from sumo_dist.math.rotations import multiply
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANNING, PLANT, Scene, SceneObject, compile_model
from sumo_dist.model.settle import settled_stand, without_robot
from sumo_dist.robots.spot import SPOT

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
HALF = 0.5**0.5
ON_SIDE = {  # an object turned by 90 deg
    "+x": (HALF, HALF, 0.0, 0.0),
    "-x": (HALF, -HALF, 0.0, 0.0),
    "+y": (HALF, 0.0, HALF, 0.0),
    "-y": (HALF, 0.0, -HALF, 0.0),
}
ATTITUDES = {"upright": UPRIGHT, **ON_SIDE}


def scene(*names: str) -> Scene:
    """Spot and objects, each called after its file."""
    return Scene(SPOT, tuple(SceneObject(name, f"objects/{name}.xml") for name in names))


class World:
    """A scene whose objects move while the robot stands out of the way, held in place."""

    def __init__(self, scene: Scene, options=PLANT):
        self.model = compile_model(scene, options)
        self.data = mujoco.MjData(self.model)
        self.index = StateIndex(self.model)
        self.robot = settled_stand(SPOT)
        self.robot[0] = -3.0

    def put(self, name: str, pos, quat=UPRIGHT) -> None:
        self.data.qpos[self.index.pose(name)] = [*pos, *quat]

    def pose(self, name: str) -> np.ndarray:
        return self.data.qpos[self.index.pose(name)].copy()

    def velocity(self, name: str) -> np.ndarray:
        return self.data.joint(f"{name}_joint").qvel.copy()

    def axis(self, name: str, axis: int) -> np.ndarray:
        return self.data.body(name).xmat.reshape(3, 3)[:, axis].copy()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.model.opt.timestep)):
            self.data.qpos[: len(self.robot)] = self.robot
            self.data.qvel[: len(self.robot) - 1] = 0.0
            mujoco.mj_step(self.model, self.data)

    def contacts(self, first: str, second: str) -> list:
        """Contacts of the bodies' geoms with each other, or with the floor (`world`)."""
        pair = {self.model.body(first).id, self.model.body(second).id}
        return [c for c in self.data.contact if set(self.model.geom_bodyid[c.geom]) == pair]


@dataclass(frozen=True)
class Facts:
    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float]
    sites: dict[str, tuple[float, float, float]]


FACTS = {
    "chair": Facts(
        16.58,
        (0, 0.06, 0.26),
        (0.25, 0.25, 0.25),
        {"site_object": (0, 0.06, 0.4), "trace": (0, 0, 0)},
    ),
    "cone": Facts(
        3.36,
        (0, 0, 0.24),
        (0.25, 0.25, 0.09),
        {"site_object": (0, 0, 0.24), "top": (0, 0, 0.673)},
    ),
    "tire": Facts(15.3, (1e-5, 0, 0), (0.57, 0.96, 0.57), {"site_object": (0, 0, 0)}),
    "rack": Facts(
        6.8,
        (0, 0, 0),
        (2.8043, 1.267, 2.8043),
        {
            "site_object": (0, 0, 0),
            "grasp_left": (0, -0.6175, 0.3),
            "grasp_left_mid": (-0.5, 0, 0.2),
            "grasp_right": (0, 0.6175, 0.3),
            "approach_left": (0, -1.0175, 0),
            "approach_mid": (-1, 0, 0),
            "approach_right": (0, 1.0175, 0),
        },
    ),
}


@pytest.mark.parametrize("name", FACTS)
def test_mass_inertia_and_sites(name):
    model, facts = compile_model(scene(name), PLANT), FACTS[name]
    body = model.body(name)
    assert body.mass == facts.mass
    np.testing.assert_array_equal(body.ipos, facts.com)
    inertia = np.zeros(9)  # MuJoCo sorts the principal axes: turn them back
    mujoco.mju_quat2Mat(inertia, body.iquat)
    axes = inertia.reshape(3, 3)
    np.testing.assert_allclose(
        axes @ np.diag(body.inertia) @ axes.T, np.diag(facts.inertia), atol=1e-12
    )
    for site, pos in facts.sites.items():
        np.testing.assert_array_equal(model.site(f"{name}/{site}").pos, pos)


@pytest.mark.parametrize("name", ["box", *FACTS])
def test_what_is_seen_neither_touches_nor_weighs_nor_is_heavy_to_draw(name):
    model = compile_model(scene(name), PLANT)
    mine = model.geom_bodyid == model.body(name).id
    seen, solid = mine & (model.geom_group == 2), mine & (model.geom_group == 3)
    touches = (model.geom_contype | model.geom_conaffinity) != 0
    assert not touches[seen].any()
    assert touches[solid].all()
    assert (seen | solid)[mine].all()
    assert 0 < seen.sum() <= 60


@pytest.mark.parametrize(
    ("name", "quat", "height", "tolerance"),
    [
        ("chair", UPRIGHT, 0.010, 1e-3),
        ("cone", UPRIGHT, 0.002, 1.5e-3),
        ("cone", ON_SIDE["-x"], 0.189, 2e-3),
        ("tire", UPRIGHT, 0.330, 1e-3),
        ("tire", ON_SIDE["+x"], 0.130, 1e-3),
        ("tire", ON_SIDE["-x"], 0.130, 1e-3),
        ("rack", UPRIGHT, 0.300, 1e-3),
        ("rack", ON_SIDE["+y"], 0.183, 3e-3),  # the released bars have square corners
        ("rack", ON_SIDE["-y"], 0.300, 1e-3),
        ("rack", ON_SIDE["+x"], 0.6325, 1e-3),
        ("rack", ON_SIDE["-x"], 0.6325, 1e-3),
    ],
)
def test_heights_at_rest(name, quat, height, tolerance):
    world = World(scene(name))
    world.put(name, (1.0, 0.0, height + 0.02), quat)
    world.run(3.0)
    assert world.pose(name)[2] == pytest.approx(height, abs=tolerance)
    assert np.abs(world.velocity(name)).max() < 1e-3


def test_a_fallen_cone_points_at_the_floor():
    world = World(scene("cone"))
    world.put("cone", (1.0, 0.0, 0.2), ON_SIDE["-x"])
    world.run(3.0)
    tilt = np.degrees(np.arccos(world.axis("cone", 2)[2]))
    assert tilt == pytest.approx(102.0, abs=1.0)


def sliding_friction(world: World, name: str) -> float:
    """Coefficient from the deceleration of an object that slides at 1 m/s."""
    world.data.joint(f"{name}_joint").qvel[0] = 1.0
    world.run(0.1)
    start = world.velocity(name)[0]
    world.run(0.3)
    return (start - world.velocity(name)[0]) / (0.3 * 9.81)


def test_the_chair_slides_on_its_castors_alone():
    world = World(scene("chair"))
    world.put("chair", (1.0, 0.0, 0.01))
    world.run(0.5)
    touching = {
        world.model.geom(geom).name
        for contact in world.contacts("chair", "world")
        for geom in contact.geom
    }
    assert touching == {"floor/ground", "chair/castors"}
    assert sliding_friction(world, "chair") == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize("side", ON_SIDE)
def test_a_tipped_chair_lies_still_on_its_hull(side):
    world = World(scene("chair"))
    world.put("chair", (1.0, 0.0, 0.45), ON_SIDE[side])
    world.run(3.0)
    assert np.abs(world.velocity("chair")).max() < 0.02
    assert np.abs(world.axis("chair", 2)[2]) < 0.2
    touching = world.contacts("chair", "world")
    assert len(touching) >= 2
    for contact in touching:
        assert contact.friction[0] == 0.3


def test_a_tire_rolls():
    """20 N at the axle for 1 s: F / (2 (m + I / r^2)) is 0.415 m, and resistance takes some."""
    world = World(scene("tire"))
    world.put("tire", (1.0, 0.0, 0.33))
    world.run(0.5)
    start = world.pose("tire")[0]
    world.data.body("tire").xfrc_applied[0] = 20.0
    world.run(1.0)
    assert 0.3 < world.pose("tire")[0] - start < 0.415
    forward, spin = world.velocity("tire")[[0, 4]]
    assert spin * 0.33 == pytest.approx(forward, rel=0.03)
    assert abs(world.axis("tire", 1)[2]) < 1e-3  # and does not fall over


@pytest.mark.parametrize("options", [PLANT, PLANNING], ids=["plant", "planning"])
def test_a_tire_that_has_lain_for_long_still_lies_on_the_floor(options):
    """Flat to within 1e-12 rad it would lose its contacts, so it is never that flat."""
    model = without_robot(scene("tire"))
    model.opt.timestep = options.timestep
    data = mujoco.MjData(model)
    for yaw in np.linspace(0.0, 2 * np.pi, 8, endpoint=False):
        mujoco.mj_resetData(model, data)
        turn = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
        data.qpos[:] = [0.0, 0.0, 0.13, *multiply(turn, np.array(ON_SIDE["+x"]))]
        mujoco.mj_step(model, data, round(5.0 / options.timestep))
        for _ in range(round(5.0 / options.timestep)):
            mujoco.mj_step(model, data)
            assert data.ncon == 3
        axle = data.body("tire").xmat.reshape(3, 3)[:, 1]
        assert np.hypot(axle[0], axle[1]) > 1e-9


def test_a_rolling_tire_comes_to_rest():
    """Resistance of about 5 % of its load: from 0.8 m/s it goes on for metres, not for ever."""
    world = World(scene("tire"))
    world.put("tire", (1.0, 0.0, 0.33))
    world.data.joint("tire_joint").qvel[:] = [0.8, 0.0, 0.0, 0.0, 0.8 / 0.33, 0.0]
    world.run(10.0)
    assert 1.0 < world.pose("tire")[0] - 1.0 < 4.0
    assert abs(world.velocity("tire")[4]) < 0.05
    assert abs(world.axis("tire", 1)[2]) < 1e-2


def gripper_at(world: World, target: np.ndarray) -> None:
    """Move the robot so that the gripper's jaw is at a point, hand down."""
    world.robot[0] = 0.0
    world.data.qpos[: len(world.robot)] = world.robot
    mujoco.mj_forward(world.model, world.data)
    jaw = world.data.geom("front_jaw_collision").xpos
    world.data.qpos[:3] += target - jaw
    mujoco.mj_forward(world.model, world.data)


def touches_robot(world: World, name: str) -> bool:
    roots = world.model.body_rootid[world.model.geom_bodyid[world.data.contact.geom]]
    pair = {world.model.body(name).id, world.model.body(SPOT.base).id}
    return any(set(row) == pair for row in roots)


def test_the_gripper_reaches_into_the_hole_and_not_into_the_rubber():
    world = World(scene("tire"))
    standing = (HALF, 0.0, 0.0, HALF)  # axle along x, as the gripper points
    world.put("tire", (0.0, 0.0, 1.0), standing)
    gripper_at(world, np.array([0.1, 0.0, 1.0]))
    assert not touches_robot(world, "tire")
    for angle in np.linspace(0.0, 2 * np.pi, 9)[:-1]:
        around = 0.265 * np.array([0.0, np.cos(angle), np.sin(angle)])
        gripper_at(world, np.array([0.0, 0.0, 1.0]) + around)
        assert touches_robot(world, "tire")


def test_a_foot_stands_in_the_hole_of_a_lying_tire():
    world = World(scene("tire"))
    world.robot[0] = 0.0
    world.data.qpos[: len(world.robot)] = world.robot
    mujoco.mj_forward(world.model, world.data)
    foot = world.data.geom("front_left_foot_collision").xpos.copy()
    behind = foot[0] - 0.08  # the shank leans back
    world.put("tire", (behind, foot[1], 0.13), ON_SIDE["+x"])
    mujoco.mj_forward(world.model, world.data)
    assert not touches_robot(world, "tire")
    world.put("tire", (behind + 0.265, foot[1], 0.13), ON_SIDE["+x"])
    mujoco.mj_forward(world.model, world.data)
    assert touches_robot(world, "tire")


def test_an_ordinary_object_meets_the_tires_rubber():
    world = World(scene("tire", "box"))
    world.put("tire", (1.0, 0.0, 0.13), ON_SIDE["+x"])
    world.put("box", (1.0, 0.0, 0.52))
    world.run(2.0)
    assert world.pose("box")[2] == pytest.approx(0.26 + 0.254, abs=3e-3)


def twins(name: str) -> Scene:
    mjcf = f"objects/{name}.xml"
    return Scene(SPOT, (SceneObject("bottom", mjcf), SceneObject("top", mjcf)))


@pytest.mark.parametrize("options", [PLANT, PLANNING])
@pytest.mark.parametrize("offset", [0.0, 0.1])
@pytest.mark.parametrize("spin", [0.0, 0.7])
def test_a_tire_on_a_tire_stays(options, offset, spin):
    world = World(twins("tire"), options)
    turned = np.zeros(4)
    mujoco.mju_mulQuat(turned, [np.cos(spin / 2), 0, 0, np.sin(spin / 2)], ON_SIDE["+x"])
    world.put("bottom", (1.0, 0.0, 0.13), ON_SIDE["+x"])
    world.put("top", (1.0 + offset, 0.0, 0.40), turned)
    world.run(1.0)
    settled = world.pose("top")
    world.run(3.0)
    assert settled[2] == pytest.approx(0.39, abs=3e-3)
    np.testing.assert_allclose(world.pose("top"), settled, atol=1e-3)
    assert np.abs(world.velocity("top")).max() < 1e-2
    assert len(world.contacts("top", "bottom")) <= 8


@pytest.mark.parametrize(
    ("name", "geom", "part", "friction"),
    [
        ("chair", "chair/base", "front_left_foot_collision", 0.3),
        ("cone", "cone/shell_1", "front_left_foot_collision", 0.5),
        ("cone", "cone/plate", "front_left_foot_collision", 1.5),
        ("tire", "tire/carcass00", "front_left_foot_collision", 1.15),
        ("rack", "rack/left_rear", "front_left_foot_collision", 0.15),
    ],
)
def test_friction_with_the_robot(name, geom, part, friction):
    world = World(scene(name))
    world.put(name, (1.0, 0.0, 2.0))
    mujoco.mj_forward(world.model, world.data)
    shift = world.data.geom(geom).xpos - world.data.geom(part).xpos
    world.data.qpos[:3] += shift
    mujoco.mj_forward(world.model, world.data)
    pair = {world.model.geom(geom).id, world.model.geom(part).id}
    touching = [c for c in world.data.contact if set(c.geom) == pair]
    assert touching
    assert touching[0].friction[0] == friction


@pytest.mark.parametrize(
    ("name", "quat", "friction"),
    [
        ("cone", UPRIGHT, {1.5}),
        ("cone", ON_SIDE["-x"], {0.5, 1.5}),
        ("tire", UPRIGHT, {1.15}),
        ("tire", ON_SIDE["+x"], {1.15}),
        ("rack", UPRIGHT, {0.7}),
    ],
)
def test_friction_with_the_floor(name, quat, friction):
    world = World(scene(name))
    world.put(name, (1.0, 0.0, 0.4), quat)
    world.run(2.0)
    assert {c.friction[0] for c in world.contacts(name, "world")} == friction


def resting(name: str, quat) -> World:
    world = World(scene(name), PLANNING)
    world.put(name, (1.0, 0.0, 0.7), quat)
    world.run(4.0)
    return world


def step_times(worlds: list[World], rounds: int) -> np.ndarray:
    """Seconds a step (worlds, rounds), the worlds in turn so that a slow moment hits all."""
    times = np.empty((len(worlds), rounds))
    for k in range(rounds):
        for row, world in enumerate(worlds):
            start = time.perf_counter()
            world.run(0.2)
            times[row, k] = time.perf_counter() - start
    return times


@pytest.mark.slow
@pytest.mark.parametrize("name", FACTS)
def test_a_step_costs_at_most_one_and_a_half_times_the_boxs(name):
    worlds = [resting("box", UPRIGHT), *(resting(name, quat) for quat in ATTITUDES.values())]
    box, *others = np.median(step_times(worlds, 60), axis=1)
    for attitude, cost in zip(ATTITUDES, others, strict=True):
        assert cost < 1.5 * box, f"{name} {attitude}: {cost / box:.2f} times the box"
