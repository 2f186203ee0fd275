from dataclasses import replace
from itertools import combinations

import mujoco
import numpy as np
import pytest

from sumo_dist.costs.parameters import Parameters
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene, SceneObject
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks.reset import REST_SPEED, Dropped, OnFloor, Reset, Ring, Start, near, redraw

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def start(move_box):
    return Start.of(move_box.scene)


def test_places_the_robot_with_its_stance_height_and_heading(start, index):
    state = start.place(np.array([1.0, -2.0]), np.pi / 2, {})
    base = state[index.pose("body")]
    assert base[:2].tolist() == [1.0, -2.0]
    assert base[2] == start.stance[2]
    assert base[3:] == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    positions, _ = index.joints(SPOT.joints)
    assert state[positions] == pytest.approx(SPOT.stand)


def test_places_objects_and_leaves_all_at_rest(start, index):
    state = start.place(np.zeros(2), 0.0, {"box": (np.array([3.0, 0.0, 0.3]), UPRIGHT)})
    assert state[index.pose("box")].tolist() == [3.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]
    assert not state[index.nq :].any()


@pytest.mark.parametrize(("x", "touching"), [(3.0, False), (0.5, True), (0.0, True)])
def test_touching_is_between_the_robot_and_the_object(start, x, touching):
    state = start.place(np.zeros(2), 0.0, {"box": (np.array([x, 0.0, 0.3]), UPRIGHT)})
    assert start.touching(state, "box") is touching


def test_the_floor_is_not_the_object(start):
    state = start.place(np.zeros(2), 0.0, {"box": (np.array([3.0, 0.0, 0.2]), UPRIGHT)})
    assert not start.touching(state, "box")


def test_redraws_until_accepted():
    draws = iter(range(100))
    assert redraw(lambda: np.array([next(draws)]), lambda state: state[0] >= 7)[0] == 7


def test_a_start_that_cannot_be_reached_is_an_error_and_no_hang():
    with pytest.raises(SumoError, match="no acceptable reset in 1000 draws"):
        redraw(lambda: np.zeros(1), lambda state: False)


THINGS = ("box", "cone", "rack")
NEAR = Ring(inner=0.0, outer=1.5, spread=0.1)


@pytest.fixture(scope="module")
def crowd():
    """Spot and three objects, of which the view names two."""
    scene = Scene(SPOT, tuple(SceneObject(name, f"objects/{name}.xml") for name in THINGS))
    frames = {"crate": FrameRef("body", "box"), "cone": FrameRef("body", "cone")}
    return Start.of(scene, frames, Parameters({"far": 0.8}))


def floor(rng):
    return rng.uniform(-1.0, 1.0, 2), float(rng.uniform(0.0, 6.0))


STANDING = (OnFloor("box", NEAR, 0.254), OnFloor("cone", NEAR, 0.002), OnFloor("rack", NEAR, 0.3))


@pytest.mark.parametrize("clearance", [0.0, 0.8])
def test_several_objects_start_apart_from_each_other_and_from_the_robot(crowd, clearance):
    reset = Reset(floor, STANDING, clearance)
    bodies = ("body", *THINGS)
    for seed in range(25):
        state = reset(np.random.default_rng(seed), crowd)
        places = [state[crowd.index.pose(body)][:2] for body in bodies]
        apart = [np.linalg.norm(a - b) for a, b in combinations(places, 2)]
        assert min(apart) > clearance
        assert not crowd.touching(state, *THINGS)
        data = mujoco.MjData(crowd.model)
        data.qpos[:] = state[: crowd.model.nq]
        mujoco.mj_forward(crowd.model, data)
        ground = crowd.model.geom("floor/ground").id
        assert all(ground in contact.geom for contact in data.contact)
        assert not state[crowd.index.nq :].any()
        heights = [state[crowd.index.pose(thing)][2] for thing in THINGS]
        assert heights == [0.254, 0.002, 0.3]


def test_objects_that_cannot_all_be_apart_are_an_error_and_no_hang(crowd):
    with pytest.raises(SumoError, match="no acceptable reset"):
        Reset(floor, STANDING, clearance=9.0)(np.random.default_rng(0), crowd)


def test_two_objects_in_one_place_touch(crowd):
    here = (np.array([2.0, 0.0, 0.3]), UPRIGHT)
    beside = (np.array([2.3, 0.0, 0.3]), UPRIGHT)
    there = (np.array([5.0, 0.0, 0.0]), UPRIGHT)
    clear = (np.array([4.0, 2.0, 0.3]), UPRIGHT)
    state = crowd.place(np.zeros(2), 0.0, {"box": here, "rack": beside, "cone": there})
    assert crowd.touching(state, *THINGS)
    assert not crowd.touching(state, "box", "cone")  # the rack was not asked about
    apart = crowd.place(np.zeros(2), 0.0, {"box": here, "rack": clear, "cone": there})
    assert not crowd.touching(apart, *THINGS)


def test_what_fell_lies_as_if_it_had_fallen_alone(crowd):
    """The others, and the robot, are taken away meanwhile; each is at rest where it came down."""
    reset = Reset(
        floor, (Dropped("box", NEAR), OnFloor("cone", NEAR, 0.002), Dropped("rack", NEAR))
    )
    attitudes = []
    for seed in range(6):
        state = reset(np.random.default_rng(seed), crowd)
        for thing in ("box", "rack"):
            assert np.linalg.norm(state[crowd.index.velocity(thing)]) < REST_SPEED
            assert np.linalg.norm(state[crowd.index.pose(thing)][3:]) == pytest.approx(1.0)
        assert not crowd.touching(state, *THINGS)
        attitudes.append(state[crowd.index.pose("rack")][3:])
    assert np.std(attitudes, axis=0).max() > 0.1


def test_what_must_not_hold_sees_frames_and_parameters(crowd):
    def beside_the_cone(r):
        return np.linalg.norm((r.crate.pos - r.cone.pos)[..., :2], axis=-1) > r.p.far

    reset = Reset(floor, STANDING, solved=beside_the_cone)
    for limit in (0.8, 1.6):
        start = replace(crowd, p=Parameters({"far": limit}))
        apart = []
        for seed in range(10):
            state = reset(np.random.default_rng(seed), start)
            box, cone = (state[crowd.index.pose(thing)][:2] for thing in ("box", "cone"))
            apart.append(np.linalg.norm(box - cone))
        assert max(apart) <= limit
    assert max(apart) > 0.8


def test_near_is_within_its_distance_and_turn():
    draws = [near((2.0, -1.0), 0.05, 0.1)(np.random.default_rng(seed)) for seed in range(200)]
    places, yaws = np.array([xy for xy, _ in draws]), np.array([yaw for _, yaw in draws])
    assert 0.04 < np.abs(places - [2.0, -1.0]).max() <= 0.05
    assert 0.08 < np.abs(yaws).max() <= 0.1


def test_a_scene_is_compiled_once_and_again_when_its_file_has_changed(tmp_path):
    crate = tmp_path / "crate.xml"
    text = (
        '<mujoco><worldbody><body name="crate"><geom type="box" size="{} .1 .1"/>'
        "</body></worldbody></mujoco>"
    )
    crate.write_text(text.format(0.1))
    scene = Scene(SPOT, (SceneObject("crate", str(crate)),))
    first, second = Start.of(scene), Start.of(scene, parameters=Parameters({"far": 1.0}))
    assert second.model is first.model
    assert second.p.far == 1.0
    with pytest.raises(UsageError, match="unknown parameter 'far'"):
        _ = first.p.far
    assert first.drop("crate") is second.drop("crate")
    crate.write_text(text.format(0.2))
    assert Start.of(scene).model is not first.model
    assert np.ptp(Start.of(scene).model.geom_size[-1]) != np.ptp(first.model.geom_size[-1])
