"""Spot's eight demonstrations: their costs, where their trials start, and what solves them."""

import mujoco
import numpy as np
import pytest

from sumo_dist.costs.view import Frame, Joints, View
from sumo_dist.episode.assemble import draw_start
from sumo_dist.math.rotations import from_rotation_vector, matrix
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.robots.spot import GRIPPER_CLOSED, GRIPPER_OPEN
from sumo_dist.tasks import load_task
from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.spot.demos import DEMONSTRATIONS
from sumo_dist.tasks.spot.demos.barrier import wrist_askew
from sumo_dist.tasks.spot.demos.rack import askew
from sumo_dist.tasks.spot.demos.rugged_box import behind
from sumo_dist.tasks.spot.demos.tire import beside, foot, height, highest, lean, too_near, tread
from sumo_dist.tasks.spot.terms import empty, lying, obstruction, once, until

NAMES = tuple(DEMONSTRATIONS)
UPRIGHTS = tuple(name for name in NAMES if name.endswith("upright"))
SEEDS = range(6)
SIDEWAYS = (np.pi / 2, 0.0, 0.0)  # a tire with this rotation lies, its axle up
WEIGHTS = {
    "tire_upright": "tilt 200 gripper 10 foot 5 torso 5 control 2",
    "barrier_upright": "lying 10000 grasp_point 500 wrist 100 approach 10 velocity 10 control 2 "
    "grasp -100",
    "cone_upright": "lying 5000 gripper 8 standoff -50 velocity 64 control 2",
    "chair_upright": "lying 5000 gripper 8 standoff -50 velocity 64 control 2",
    "tire_stack": "apart 100 height 200 lean 20 bottom 50 gripper 10 torso 10 too_high 1000 "
    "control 1",
    "barrier_drag": "goal 500 lying 50 grasp_point 250 wrist 100 velocity 10 control 2 "
    "grasp -100 tipped 2500",
    "rack_drag": "goal 500 askew 50 grasp_point 250 wrist 250 approach 100 grasp -100 tipped 2500",
    "box_push": "goal 500 askew 50 torso 30 gripper 0.1 control 2",
}
OURS = {"low", "spin", "hands off", "done", "upright", "empty", "fall"}
PLACES = {  # of the robot and of what it moves [m], and how far from there they may be
    "barrier_upright": ((0.0, 0.0), (2.0, 0.0), 0.25),
    "tire_stack": ((-2.0, -2.0), (-2.0, 0.0), 0.11),
    "barrier_drag": ((-1.5, 0.0), (2.0, 0.0), 0.11),
    "rack_drag": ((-1.5, 0.0), (2.0, 0.0), 0.11),
    "box_push": ((1.0, 0.0), (0.5, 2.0), 0.21),
}


def frame(pos, turn=(0.0, 0.0, 0.0), velocity=(0.0,) * 6):
    """A frame at a place, turned by a rotation vector: one rollout of one step."""
    rot = matrix(from_rotation_vector(np.array(turn)))
    moves = np.array(velocity)[None, None]
    return Frame("frame", np.array(pos, float)[None, None], rot[None, None], moves)


def seen(residual, actions=(0.0,) * 9, p=None, **frames):
    """Value of a residual for frames of one step."""
    view = View(frames, np.array(actions)[None, None], *([] if p is None else [p]))
    return float(residual(view)[0, 0])


def with_jaw(pos, vel, target):
    """A view of nothing but the jaw: where it is, how fast, where it is sent to."""
    states, targets = np.array([[[pos, vel]]]), np.array([[[target]]])
    joints = Joints(states, targets, {"arm_f1x": (0, 1)}, {"arm_f1x": 0})
    return View({}, np.zeros((1, 1, 9)), joints=joints)


@pytest.fixture(scope="module", params=NAMES)
def demo(request):
    return load_task(request.param)


@pytest.fixture(scope="module")
def starts(demo):
    """Index and the states of some seeds."""
    return StateIndex(compile_model(demo.scene, PLANT)), [draw_start(demo, s) for s in SEEDS]


def short(task):
    return task.name.removeprefix("spot/demo_")


def test_weights_are_the_papers_and_what_is_ours_is_named(demo):
    words = iter(WEIGHTS[short(demo)].split())
    papers = {
        name.replace("_", " "): float(weight) for name, weight in zip(words, words, strict=True)
    }
    weights = {term.name: term.weight for term in demo.cost}
    assert {name: weights[name] for name in papers} == papers
    assert weights.keys() - papers.keys() <= OURS
    assert demo.cost[-1].name == "fall"


def test_times_are_the_papers_and_success_is_held(demo):
    limits = {"chair_upright": 60.0, "box_push": 90.0}
    assert demo.time_limit == limits.get(short(demo), 30.0)
    assert demo.success_hold == 0.5


def test_starts_are_apart_unsolved_and_where_they_should_be(demo, starts):
    index, states = starts
    start = Start.of(demo.scene, demo.frames, demo.table.named(demo.table.defaults.parameters))
    things = [thing.name for thing in demo.scene.objects]
    assert len({state.tobytes() for state in states}) == len(states)
    for state in states:
        now = start.view(state)
        assert not demo.success(now).any()
        assert not any(test(now).any() for test in demo.failure.values())
        assert not start.touching(state, *things)
        if short(demo) in PLACES:
            robot, moved, off = PLACES[short(demo)]
            assert np.abs(state[index.pose("body")][:2] - robot).max() < off
            assert np.abs(state[index.pose(things[-1])][:2] - moved).max() < off


@pytest.mark.parametrize("name", UPRIGHTS)
def test_what_is_to_stand_has_really_fallen(name):
    """It lies for three seconds more, the robot taken away, and not always on the same side."""
    task = load_task(name)
    model = compile_model(task.scene, PLANT)
    index, data, (thing,) = StateIndex(model), mujoco.MjData(model), task.scene.objects
    axis = 1 if thing.name == "tire" else 2
    sides = []
    for seed in SEEDS:
        state = draw_start(task, seed)
        data.qpos[:], data.qvel[:] = index.unpack(state)
        data.qpos[index.pose("body")][:2] += 50.0
        mujoco.mj_step(model, data, 300)
        up = matrix(data.qpos[index.pose(thing.name)][3:])[2]
        assert abs(up[axis]) > 0.7 if thing.name == "tire" else up[axis] < 0.7
        sides.append(np.round(np.delete(up, axis) if thing.name != "tire" else up[1]))
    assert len(np.unique(sides, axis=0)) > 1


def test_a_standing_object_that_is_still_solves_an_upright():
    for name in UPRIGHTS:
        task, p = (
            load_task(name),
            load_task(name).table.named(load_task(name).table.defaults.parameters),
        )
        for turn, velocity, solved in (
            ((0.0, 0.0, 0.0), 0.0, True),
            ((0.099, 0.0, 0.0), 0.0, True),
            ((0.101, 0.0, 0.0), 0.0, False),
            ((0.0, 0.0, 0.0), 0.051, False),
        ):
            thing = frame((1.0, 0.0, 0.3), turn, (0.0, 0.0, 0.0, 0.0, velocity, 0.0))
            view = View({"object": thing}, np.zeros((1, 1, 9)), p)
            assert task.success(view).tolist() == [[solved]], (name, turn, velocity)


@pytest.mark.parametrize(
    ("jaw", "firm", "closed_on_nothing"),
    [
        ((-0.4, 0.0, GRIPPER_CLOSED), 0.8, False),  # around a rail
        ((-0.9, 0.0, GRIPPER_CLOSED), 1.0, False),
        ((-0.4, 3.0, GRIPPER_CLOSED), 0.0, False),  # on its way
        ((-0.01, 0.0, GRIPPER_CLOSED), 0.0, True),
        ((-0.4, 0.0, GRIPPER_OPEN), 0.0, False),  # something keeps it from opening
        ((GRIPPER_OPEN, 0.0, GRIPPER_OPEN), 0.0, False),
        ((-0.01, 0.0, GRIPPER_OPEN), 0.0, False),
    ],
)
def test_a_grasp_is_a_closing_jaw_that_something_holds_open(jaw, firm, closed_on_nothing):
    view = with_jaw(*jaw)
    assert obstruction(view)[0, 0] == pytest.approx(firm)
    assert empty(view)[0, 0] == closed_on_nothing


def test_a_term_is_off_until_or_once_a_thing_is_done():
    view = View({"base": frame((0.0, 0.0, 0.5))}, np.zeros((1, 2, 9)))
    done, value = (lambda r: np.array([[False, True]])), (lambda r: np.array([[3.0, 4.0]]))
    assert until(done, value)(view).tolist() == [[3.0, 0.0]]
    assert once(done, value)(view).tolist() == [[0.0, 4.0]]


def test_lying_is_nothing_upright_and_nearly_one_on_its_side():
    for turn, expected in (((0.0, 0.0, 0.0), 0.0), (SIDEWAYS, 1 - np.exp(-3.0))):
        assert seen(lying(3.0), object=frame((0, 0, 0), turn)) == pytest.approx(expected)


def test_the_tires_points_are_where_the_paper_has_them():
    tire, base = frame((1.0, 0.0, 0.13), SIDEWAYS), frame((0.0, 0.0, 0.13))
    at = {"object": tire, "base": base}
    assert seen(tread, gripper=frame((0.72, 0.0, 0.23)), **at) == pytest.approx(0.0)
    c = 0.33 * np.sqrt(0.5)
    right, left = frame((1 - c, -c, 0.1)), frame((1 - c, c, 0.1))
    far = frame((5.0, 5.0, 0.1))
    assert seen(foot, right_foot=right, left_foot=far, **at) == pytest.approx(0.0)
    assert seen(foot, right_foot=far, left_foot=left, **at) == pytest.approx(0.0)


def test_a_stack_is_measured_between_the_tires():
    bottom, top = frame((0.0, 0.0, 0.13), SIDEWAYS), frame((0.3, 0.0, 0.44), SIDEWAYS)
    both = {"bottom": bottom, "top": top}
    assert seen(height, **both) == pytest.approx(0.05)
    down = frame((0.0, 0.0, 0.39), tuple(-np.array(SIDEWAYS)))  # its axle points down
    assert seen(lean, bottom=bottom, top=down) == pytest.approx(0.0)
    assert seen(lean, bottom=bottom, top=frame((2.5, 0.0, 0.33))) == 0.0
    standing = frame((0.0, 1.0, 0.33))
    assert seen(highest, gripper=frame((0.0, 1.0, 0.66)), top=standing) == pytest.approx(0.0)
    away = {"bottom": bottom, "top": frame((0.0, -2.0, 0.33))}
    turn = np.deg2rad(-25.0)  # from straight behind, seen from the lower tire
    place = (0.8 * np.sin(turn), -2.0 - 0.8 * np.cos(turn), 0.52)
    assert seen(beside, base=frame(place), **away) == pytest.approx(0.0, abs=5e-3)


@pytest.mark.parametrize(
    ("gripper", "near"),
    [
        ((0.0, 0.0, 0.39), 0.2),  # within the tire
        ((0.0, 0.0, 0.39 + 0.13 + 0.04), 0.16),  # above its side
        ((0.33 + 0.25, 0.0, 0.39), -0.05),  # beyond its tread
    ],
)
def test_nearness_is_to_the_tires_surface(gripper, near):
    top = frame((0.0, 0.0, 0.39), SIDEWAYS)
    assert seen(too_near, gripper=frame(gripper), top=top) == pytest.approx(near)


def test_a_wrist_points_at_the_barrier_along_it_with_its_y_along_the_posts():
    barrier, rolled = frame((0, 0, 0)), frame((-1.2, 0, 0.5), SIDEWAYS)
    assert seen(wrist_askew, object=barrier, wrist=frame((-1.2, 0, 0.5))) == pytest.approx(1.0)
    assert seen(wrist_askew, object=barrier, wrist=rolled) == pytest.approx(0.0, abs=1e-9)
    beyond = frame((1.2, 0, 0.5), SIDEWAYS)  # at the other end, where it points away
    assert seen(wrist_askew, object=barrier, wrist=beyond) == pytest.approx(2.0)
    assert seen(askew, object=frame((0, 0, 0), (0.0, 0.0, np.pi))) == pytest.approx(4.0)


def test_a_box_is_pushed_from_behind_and_low():
    task = load_task("spot/demo_box_push")
    p = task.table.named(task.table.defaults.parameters)
    at = {"object": frame((0.0, 2.0, 0.0)), "p": p}
    assert seen(behind, base=frame((0.0, 2.6, 0.4)), **at) == pytest.approx(0.0)
    assert seen(behind, base=frame((0.0, 2.6, 0.52)), **at) == pytest.approx(0.12)
    torso = task.actions.names.index("torso_height")
    assert (task.actions.upper[torso], task.actions.default[torso]) == (0.4, 0.4)
