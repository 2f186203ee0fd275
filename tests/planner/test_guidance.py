from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.errors import PolicyError
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import SceneObject
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.guidance import LearnedGuide, ObjectFirst, make_guide
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task, task_names
from sumo_dist.tasks.task import Goal

GUIDED = PlannerConfig(guidance="object")
PUSHED = [
    name
    for name in task_names()
    if name.startswith("spot/move_") or (name.startswith("g1/") and name.endswith("_push"))
]


def guide_of(task, config=GUIDED):
    return ObjectFirst(Problem.build(task, planning_options(config)), config)


@pytest.fixture(scope="module")
def guide():
    return guide_of(load_task("spot/move_box"))


@pytest.fixture
def state(move_box):
    """The robot at (-2, 0) looks along x, and the box is level at (-0.5, 0)."""
    state = draw_start(move_box, seed=1).copy()
    state[:2], state[3:7] = (-2.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    box = state[26:33]
    box[:2], box[3:] = (-0.5, 0.0), (1.0, 0.0, 0.0, 0.0)
    return state


def parameters(task, x=0.0, y=0.0):
    return task.table.adjusted([], [f"goal={x},{y}"]).parameters


def test_the_ground_is_read_from_model_and_state(guide, state, move_box):
    ground = guide.ground(state, parameters(move_box, 1.0, 0.0))
    assert (ground.base, ground.heading) == (-2.0, 1.0)
    assert ground.centre == pytest.approx(-0.5)
    assert ground.way == pytest.approx(1.5)
    assert (ground.back, ground.width) == pytest.approx((0.254, 0.508), abs=1e-3)
    assert ground.reach == pytest.approx(0.42, abs=0.02)  # the body; the arm is above the box
    assert ground.keep == pytest.approx(0.359 + 0.27, abs=0.02)  # diagonal, half of the robot


def test_a_turned_box_is_longer_along_its_diagonal(guide, state, move_box):
    state[29:33] = np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8)
    ground = guide.ground(state, parameters(move_box))
    assert (ground.back, ground.width) == pytest.approx((0.359, 0.718), abs=1e-3)


def test_what_is_as_high_as_the_object_reaches_for_it(guide, state, move_box):
    level = guide.ground(state, parameters(move_box)).reach
    state[28] += 0.5  # where the arm is
    assert guide.ground(state, parameters(move_box)).reach > level + 0.3


def test_knots_push_straight_ahead_and_end_slowly(guide, state, move_box):
    knots = guide.walk(state, parameters(move_box, 3.0))
    assert knots == pytest.approx(np.tile([1.0, 0.0, 0.0], (4, 1)), abs=1e-9)
    state[0] = -1.15  # it touches the box, 0.1 m from where that should be
    slow = guide.walk(state, parameters(move_box, -0.4))[:, 0]
    assert 0.0 < slow[-1] < 0.1 < slow[0] < 1.0


def test_state_and_parameters_alone_decide(guide, state, move_box):
    there, back = parameters(move_box, 3.0), parameters(move_box, -3.0)
    first = guide.walk(state, there)
    assert not np.array_equal(guide.walk(state, back), first)
    assert np.array_equal(guide.walk(state, there), first)
    assert np.array_equal(guide_of(move_box).walk(state, there), first)


def test_all_but_the_base_stays_as_it_is_planned(guide, state, move_box):
    mean = np.random.default_rng(0).uniform(-1.0, 1.0, (4, move_box.actions.size))
    before, there, base = mean.copy(), parameters(move_box, 3.0), move_box.actions.base
    knots = guide(state, there, mean)
    assert np.array_equal(mean, before)
    assert np.array_equal(knots[:, ~base], mean[:, ~base])
    assert np.array_equal(knots[:, base], guide.walk(state, there))


@pytest.mark.parametrize("name", PUSHED)
def test_every_task_that_pushes_is_guided(name):
    task = load_task(name)
    config = PlannerConfig.resolve(task.planner, settings=["guidance=object"])
    guide = make_guide(Problem.build(task, planning_options(config)), config)
    assert isinstance(guide, ObjectFirst)
    knots = guide.walk(draw_start(task, 101), task.table.defaults.parameters)
    assert knots.shape == (config.nodes - 1, 3)
    assert np.abs(knots).max() <= 1.0 + 1e-12
    assert np.abs(knots[:, :2]).max() > 0.5


@pytest.mark.parametrize(
    "settings",
    [
        {"spline": "zero", "nodes": 1},
        {"spline": "cubic", "nodes": 100, "horizon": 0.1},
        {"nodes": 3, "horizon": 0.02},
        {"nodes": 12, "horizon": 4.0, "model": "full"},
    ],
)
def test_any_spline_has_knots_of_the_walk(state, move_box, settings):
    config = replace(GUIDED, **settings)
    knots = guide_of(move_box, config).walk(state, parameters(move_box, 3.0))
    assert len(knots) == config.nodes - (config.spline == "smooth")
    assert knots == pytest.approx(np.tile([1.0, 0.0, 0.0], (len(knots), 1)), abs=1e-9)


def test_of_several_objects_it_is_the_one_with_the_goal(move_box):
    things = (SceneObject("box", "objects/box.xml"), SceneObject("cone", "objects/cone.xml"))
    frames = {**move_box.frames, "tip": FrameRef("site", "cone/site_object")}
    scene = replace(move_box.scene, objects=things)
    task = replace(move_box, scene=scene, frames=frames, goal=Goal("tip", 0.0))
    assert task.goal_object == "cone"
    state = np.concatenate([draw_start(move_box, 1)[:33], [2.0, 1.0, 0.0, 1, 0, 0, 0]])
    ground = guide_of(task).ground(state, parameters(task))
    assert ground.centre == pytest.approx(2.0 + 1.0j, abs=0.05)
    assert ground.way == pytest.approx(-2.0 - 1.0j, abs=0.05)


def test_without_guidance_there_is_no_guide(problem):
    assert make_guide(problem, PlannerConfig()) is None


def test_an_object_that_nothing_can_touch_is_a_point(state, move_box, tmp_path):
    ghost = (
        "<mujoco><worldbody><body><freejoint/><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"
    )
    (tmp_path / "ghost.xml").write_text(f"{ghost}</body></worldbody></mujoco>")
    scene = replace(move_box.scene, objects=(SceneObject("box", str(tmp_path / "ghost.xml")),))
    guide = guide_of(
        replace(move_box, scene=scene, frames={"object": FrameRef("body", "box")}, trails=())
    )
    ground = guide.ground(state, parameters(move_box))
    assert (ground.back, ground.width) == (0.0, 0.0)
    assert np.isfinite(guide.walk(state, parameters(move_box))).all()


TIMES = 0.0, 0.5, 1.0


@pytest.fixture(scope="module")
def learned(drawn_policy, tmp_path_factory):
    """A policy with three knots, and where its file is."""
    path = tmp_path_factory.mktemp("learned") / "policy.onnx"
    policy = drawn_policy("spot/move_box", seed=7, times=TIMES)
    policy.save(path)
    return policy, path


@pytest.mark.parametrize("spline", ["smooth", "linear"])
def test_a_learned_policy_proposes_at_the_knots_of_the_plan(state, move_box, learned, spline):
    policy, path = learned
    config = PlannerConfig(guidance="learned", policy=str(path), spline=spline, nodes=5)
    problem = Problem.build(move_box, planning_options(config))
    guide, there = make_guide(problem, config), parameters(move_box, 3.0)
    assert isinstance(guide, LearnedGuide)
    plan = np.full((4 if spline == "smooth" else 5, 9), 0.3)
    knots = guide(state, there, plan)
    (own,) = policy(Observer(move_box, problem.model)(state[None], move_box.table.named(there)))
    if spline == "smooth":  # at 0, 0.5, 1 and 1.5 s
        assert np.array_equal(knots, own[[0, 1, 2, 2]])
    else:  # 0.375 s apart
        between = own[0] + 0.75 * (own[1] - own[0]), own[1] + 0.5 * (own[2] - own[1])
        assert knots == pytest.approx(np.stack([own[0], *between, own[2], own[2]]))


def test_what_a_policy_cannot_say_stays_as_in_the_last_plan(state, move_box, learned, tmp_path):
    policy, _ = learned
    trust = np.zeros((len(TIMES), 9))
    trust[0], trust[1, :3] = 1.0, 0.5
    trusted = replace(
        policy, contract=replace(policy.contract, trust=tuple(trust.ravel().tolist()))
    )
    trusted.save(tmp_path / "policy.onnx")
    config = PlannerConfig(guidance="learned", policy=str(tmp_path / "policy.onnx"))
    problem = Problem.build(move_box, planning_options(config))
    there, plan = parameters(move_box, 3.0), np.full((4, 9), 0.3)
    (own,) = policy(Observer(move_box, problem.model)(state[None], move_box.table.named(there)))
    knots = LearnedGuide(problem, config)(state, there, plan)  # at 0, 0.5, 1 and 1.5 s
    assert np.array_equal(knots[0], own[0])
    assert knots[1, :3] == pytest.approx(0.5 * own[1, :3] + 0.15)
    assert np.array_equal(knots[1, 3:], plan[1, 3:])
    assert np.array_equal(knots[2:], plan[2:])


def test_a_policy_guides_only_what_it_was_made_for(learned):
    config = PlannerConfig(guidance="learned", policy=str(learned[1]))
    problem = Problem.build(load_task("g1/box_push"), planning_options(config))
    with pytest.raises(PolicyError, match="whose robot is spot cannot do task 'g1/box_push'"):
        make_guide(problem, config)
