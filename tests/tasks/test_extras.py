"""Spot's three extra tasks against the released code, and against where their trials start."""

import mujoco
import numpy as np
import pytest
from numpy import mean
from numpy.linalg import norm

from sumo_dist.costs.terms import evaluate
from sumo_dist.costs.view import Frame, View, ViewLayout
from sumo_dist.episode.assemble import draw_start
from sumo_dist.math.rotations import from_rotation_vector, matrix
from sumo_dist.model.files import find_model, read_model
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task
from sumo_dist.tasks.spot.extras import EXTRAS, ramp
from sumo_dist.tasks.spot.extras.navigate import COURSE, GIRTH, OUTLINE, clearance, prisms

T = 6


@pytest.fixture(scope="module", params=EXTRAS)
def task(request):
    return load_task(request.param)


@pytest.fixture(scope="module")
def starts(task):
    model = compile_model(task.scene, PLANT)
    return model, [draw_start(task, seed) for seed in range(20)]


def usual(task):
    """The task's parameters at their defaults."""
    return task.table.named(task.table.defaults.parameters)


def random_view(task, seed=0, lean=0.05):
    """One rollout of T steps whose frames are anywhere, not far from level, the robot upright."""
    rng = np.random.default_rng(seed)

    def frame(name):
        turn = rng.normal(size=(1, T, 3)) * [lean, lean, 1.0]
        rotation = matrix(from_rotation_vector(turn))
        return Frame(name, rng.normal(size=(1, T, 3)), rotation, rng.normal(size=(1, T, 6)))

    frames = {name: frame(name) for name in task.frames}
    frames["base"].pos[..., 2] = 0.5
    return View(frames, rng.normal(size=(1, T, len(task.actions.names))), usual(task))


def still(task, turns=None, **places):
    """A view of one step, all frames at rest at given places, level but for given turns [rad]."""
    frames = {}
    for name in task.frames:
        pos = np.array(places.get(name, (0.0, 0.0, 1.0)), float).reshape(1, 1, 3)
        rotation = matrix(from_rotation_vector(np.array((turns or {}).get(name, (0.0,) * 3))))
        frames[name] = Frame(name, pos, rotation.reshape(1, 1, 3, 3), np.zeros((1, 1, 6)))
    return View(frames, np.zeros((1, 1, len(task.actions.names))), usual(task))


def total(task, r):
    """Weighted cost of the one rollout of a view."""
    return evaluate(task.cost, r)[0] @ task.table.defaults.weights


def term(task, name, r):
    """Weighted cost of one term of the one rollout of a view."""
    index = [term.name for term in task.cost].index(name)
    return (evaluate(task.cost, r)[0] * task.table.defaults.weights)[index]


def test_the_cost_of_the_ramp_is_the_releases():
    task = load_task("spot/chair_ramp")
    r = random_view(task)
    chair, base = r.object.pos[0], r.base.pos[0]
    x, y = chair[:, 0], chair[:, 1]
    expected = (
        100 * mean(norm(chair - [2.0, 4.5, 0.26], axis=1))
        - 0.25 * mean(norm(base - chair, axis=1))
        + 4 * mean(norm(r.gripper.pos[0] - r.aim.pos[0], axis=1))
        + 128 * mean(norm(r.object.linvel[0], axis=1)) ** 2
        + 2 * mean(norm(r.actions[0, :, :3], axis=1))
        + 1000 * mean((x <= 1.0) | (x >= 3.0) | (y >= 5.25))
        + 15 * mean(np.abs(x - 2.0))
        + 1000 * mean(base[:, 1] >= 4.5)
    )
    assert total(task, r) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "places", "cost"),
    [
        ("off lane", {"object": (2.0, 5.24, 0.26)}, 0.0),
        ("off lane", {"object": (2.0, 5.26, 0.26)}, 1000.0),
        ("off lane", {"object": (1.01, 2.0, 0.26)}, 0.0),
        ("off lane", {"object": (0.99, 2.0, 0.26)}, 1000.0),
        ("off lane", {"object": (3.01, 2.0, 0.26)}, 1000.0),
        ("robot's end", {"base": (2.0, 4.49, 0.7)}, 0.0),
        ("robot's end", {"base": (2.0, 4.51, 0.7)}, 1000.0),
        ("fall", {"base": (2.0, 4.0, 0.17)}, 10000.0),
    ],
)
def test_ends_of_the_ramp_cost(name, places, cost):
    task = load_task("spot/chair_ramp")
    assert term(task, name, still(task, **places)) == cost


@pytest.mark.parametrize(("angle", "cost"), [(0.4, 0.0), (0.42, 10000.0)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_chair_that_tips_to_any_side_costs(angle, cost, axis):
    """From sin(tilt) = 0.4 on; the incline itself tilts it by 0.126."""
    task = load_task("spot/chair_ramp")
    turn = np.eye(3)[axis] * angle
    assert term(task, "tipped", still(task, {"object": turn})) == cost


@pytest.mark.parametrize(
    ("place", "turn", "speed", "solved"),
    [
        ((2.0, 4.5, 0.26), (0.0, 0.0, 0.0), 0.0, True),
        ((2.0, 4.4, 0.26), (0.0, 0.0, 3.0), 0.04, True),
        ((2.0, 4.38, 0.26), (0.0, 0.0, 0.0), 0.0, False),  # a castor on the incline
        ((2.95, 4.8, 0.26), (0.0, 0.0, 0.0), 0.0, False),  # over the edge
        ((2.0, 4.5, 0.2), (0.0, 0.0, 0.0), 0.0, False),
        ((2.0, 4.5, 0.26), (0.0, 0.0, 0.0), 0.06, False),
        ((2.0, 4.5, 0.35), (1.5, 0.0, 0.0), 0.0, False),  # lying there
        ((2.0, 0.5, 0.01), (0.0, 0.0, 0.0), 0.0, False),
    ],
)
def test_the_ramp_ends_with_the_chair_at_rest_on_the_platform(place, turn, speed, solved):
    task = load_task("spot/chair_ramp")
    r = still(task, {"object": turn}, object=place)
    r.object.velocity[..., 0] = speed
    assert task.success(r).tolist() == [[solved]]


def test_the_ramp_is_where_the_task_has_it():
    """And where the release has it: platform, slope and lip; its foot ours, on the floor."""
    model = read_model(find_model("fixtures/ramp.xml"), "ramp").compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    platform, incline, lip = (model.geom(name).id for name in ("platform", "incline", "lip"))
    np.testing.assert_allclose(data.geom_xpos[platform][:2], ramp.CENTRE)
    np.testing.assert_allclose(model.geom_size[platform][:2], ramp.HALF)
    assert 2 * model.geom_size[platform][2] == ramp.HEIGHT == 0.25
    np.testing.assert_allclose(data.geom_xpos[lip], [1.875, 4.192, 0.203])
    rot, size = data.geom_xmat[incline].reshape(3, 3), model.geom_size[incline]
    assert np.arcsin(rot[2, 1]) == pytest.approx(2 * np.arcsin(0.0628), abs=1e-3)
    top, foot = (data.geom_xpos[incline] + rot @ (size * [0, s, 1]) for s in (1, -1))
    np.testing.assert_allclose(top[1:], [4.192, 0.25], atol=1e-3)
    np.testing.assert_allclose(foot[1:], [ramp.FOOT, 0.0], atol=1e-2)
    assert foot[2] <= 0.0


def test_the_cost_of_rolling_is_the_releases():
    task = load_task("spot/tire_roll")
    r = random_view(task, lean=0.01)
    tire, goal = r.object.pos[0], np.array([0.0, 0.0, 0.33])
    d = (goal - tire) / (0.01 + norm(goal - tire, axis=1))[:, None]
    low = (tire - 0.15 * d) * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.05]
    expected = (
        60 * mean(norm(tire - goal, axis=1))
        + mean(norm(r.base.pos[0] - (tire - d), axis=1))
        + mean(norm(r.gripper.pos[0] - low, axis=1))
        + 10 * mean(norm(r.object.linvel[0], axis=1))
        + 0.3 * mean(norm(r.object.angvel[0], axis=1))
    )
    assert total(task, r) == pytest.approx(expected)


@pytest.mark.parametrize(("lean", "cost"), [(0.09, 0.0), (0.11, 500.0), (-0.11, 500.0)])
def test_a_tire_that_leans_costs_to_both_sides(lean, cost):
    task = load_task("spot/tire_roll")
    assert term(task, "lean", still(task, {"object": (lean, 0.0, 0.0)})) == cost


@pytest.mark.parametrize(
    ("place", "lean", "speed", "solved"),
    [
        ((0.0, 0.0, 0.33), 0.0, 0.0, True),
        ((0.1, -0.27, 0.33), 0.15, 0.04, True),
        ((0.31, 0.0, 0.33), 0.0, 0.0, False),
        ((0.0, 0.0, 0.33), 0.0, 0.06, False),
        ((0.0, 0.0, 0.13), np.pi / 2, 0.0, False),
    ],
)
def test_rolling_ends_with_the_tire_standing_at_its_goal(place, lean, speed, solved):
    task = load_task("spot/tire_roll")
    r = still(task, {"object": (lean, 0.0, 0.0)}, object=place)
    r.object.velocity[..., 0] = speed
    assert task.success(r).tolist() == [[solved]]


def test_the_cost_of_the_walk_is_the_releases_and_the_obstacles():
    task = load_task("spot/navigate")
    r = random_view(task)
    for name in ("base", "gripper"):
        r[name].pos[..., 0] -= 20.0  # far from all obstacles
    expected = 60 * mean(norm(r.base.pos[0] - [2.0, 0.0, 0.52], axis=1))
    expected += 2 * mean(norm(r.actions[0], axis=1))
    assert total(task, r) == pytest.approx(expected)
    assert task.table.defaults.weights.tolist() == [60.0, 500.0, 2.0, 2500.0]
    assert task.actions.names == ("base_vx", "base_vy", "base_wz")


@pytest.mark.parametrize(
    ("base", "yaw", "gap"),
    [
        ((-2.0, 0.0), 0.0, 2.0 - 0.36 - 0.32 - 0.06),  # head on to the wall
        ((-2.0, 0.0), np.pi / 2, 2.0 - 0.32 - 0.06),  # alongside it
        ((0.0, 1.2), 0.0, 0.6 - 0.32),  # in the gap
        ((0.0, 1.1), np.pi / 2, 0.14 - 0.32),  # across it
        ((1.25, 2.2), np.pi / 2, 0.94 - 0.08 - 0.32),  # beside the post
        ((2.0, 0.0), np.pi / 2, 0.65 - 0.32),  # beside the crate
        ((0.0, 0.0), np.pi / 2, -0.32 - 0.06),  # in the wall
    ],
)
def test_room_is_from_the_robots_outline_to_the_nearest_side(base, yaw, gap):
    task = load_task("spot/navigate")
    r = still(task, {"base": (0.0, 0.0, yaw)}, base=(*base, 0.5), gripper=(-9.0, 0.0, 0.5))
    np.testing.assert_allclose(clearance(tuple(prisms(COURSE.mjcf)))(r), gap, atol=1e-9)
    assert (term(task, "collision", r) > 0) == (gap < 0)


def test_the_outline_covers_feet_and_knees():
    """So that what costs nothing touches nothing."""
    task = load_task("spot/navigate")
    model = compile_model(task.scene, PLANT)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = StateIndex(model).unpack(draw_start(task, 0))
    mujoco.mj_kinematics(model, data)
    base = data.body("body")
    centres = [base.xpos + s * base.xmat.reshape(3, 3)[:, 0] for s in OUTLINE]
    legs = ("front_left", "front_right", "rear_left", "rear_right")
    feet = [data.site(f"site_{leg}").xpos for leg in legs]
    knees = [data.body(f"{leg}_lower_leg").xpos for leg in legs]
    for point in (*feet, *knees):
        assert min(norm((point - centre)[:2]) for centre in centres) < GIRTH


@pytest.mark.parametrize(
    ("place", "speed", "solved"),
    [
        ((2.0, 0.0, 0.5), 0.0, True),
        ((1.9, 0.2, 0.6), 0.09, True),
        ((1.74, 0.0, 0.5), 0.0, False),
        ((2.0, 0.0, 0.5), 0.11, False),
        ((-2.2, 0.0, 0.5), 0.0, False),
    ],
)
def test_the_walk_ends_at_rest_at_its_goal(place, speed, solved):
    task = load_task("spot/navigate")
    r = still(task, base=place)
    r.base.velocity[..., 0] = speed
    assert task.success(r).tolist() == [[solved]]


def test_the_straight_way_is_barred():
    task = load_task("spot/navigate")
    room = clearance(tuple(prisms(COURSE.mjcf)))
    for seed in range(20):
        x, y = draw_start(task, seed)[:2]
        along = np.linspace(0.0, 1.0, 50)
        rooms = [
            room(still(task, base=(x + s * (2 - x), y * (1 - s), 0.5), gripper=(-9, 0, 0.5)))
            for s in along
        ]
        assert rooms[0] > 0 > min(rooms)
        assert rooms[-1] > 0


def test_starts_are_apart_clear_and_unsolved(task, starts):
    model, states = starts
    data, layout = mujoco.MjData(model), ViewLayout(model, task.frames)
    index = StateIndex(model)
    for state in states:
        data.qpos[:], data.qvel[:] = index.unpack(state)
        mujoco.mj_forward(model, data)
        now = layout.at(data, len(task.actions.names), usual(task))
        assert not task.success(now).any()
        assert not any(test(now).any() for test in task.failure.values())
        assert all(contact.dist > -1e-3 for contact in data.contact)
        assert not data.qvel.any()
    assert len({state.tobytes() for state in states}) == len(states)
    np.testing.assert_array_equal(draw_start(task, 3), states[3])


def test_robots_start_where_the_release_has_them():
    chairs = [draw_start(load_task("spot/chair_ramp"), seed) for seed in range(20)]
    index = StateIndex(compile_model(load_task("spot/chair_ramp").scene, PLANT))
    for state in chairs:
        robot, chair = state[:2], state[index.pose("chair")][:2]
        assert np.abs(chair - [2.0, 0.5]).max() <= 0.3
        assert np.abs(robot - [2.0, -0.7]).max() <= 2.0
        assert norm(robot - chair) > 1.2
    tires = [draw_start(load_task("spot/tire_roll"), seed) for seed in range(20)]
    index = StateIndex(compile_model(load_task("spot/tire_roll").scene, PLANT))
    for state in tires:
        tire = state[index.pose("tire")][:2]
        assert np.abs(tire).max() <= 1.5
        assert norm(tire) > 1.0
        assert norm(state[:2]) == 0.0
