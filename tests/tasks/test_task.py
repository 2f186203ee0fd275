from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.costs.parameters import Parameter
from sumo_dist.errors import UsageError
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import SceneObject
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.robots.joint_actions import joint_actions
from sumo_dist.robots.spot import SPOT
from sumo_dist.tasks import load_task, task_names
from sumo_dist.tasks.task import Goal


@pytest.mark.parametrize("name", task_names())
def test_every_task_loads_under_its_name(name):
    task = load_task(name)
    assert task.name == name
    assert name.startswith(task.scene.robot.name)
    assert {"base", *task.trails} <= set(task.frames)


def test_an_unknown_task_names_the_valid_ones():
    with pytest.raises(UsageError, match=r"unknown task 'spot/move_bx'; valid: .*spot/move_box"):
        load_task("spot/move_bx")


def test_two_terms_of_one_name_are_refused(move_box):
    with pytest.raises(UsageError, match=r"need distinct names, got \['goal', 'goal'\]"):
        replace(move_box, cost=(move_box.cost[0], move_box.cost[0]))


def test_an_empty_cost_table_is_refused(move_box):
    with pytest.raises(UsageError, match="cost terms need distinct names"):
        replace(move_box, cost=())


def test_missing_frames_are_named(move_box):
    with pytest.raises(UsageError, match=r"frames lack \['wheel'\]"):
        replace(move_box, trails=("gripper", "wheel"))


def bare(move_box, **changes):
    """A task that names no frames but those of its box."""
    frames = {"object": FrameRef("body", "box")}
    return replace(move_box, **{"frames": frames, "trails": (), **changes})


def test_the_robots_base_is_a_frame_that_needs_no_naming(move_box):
    task = bare(move_box)
    assert task.frames["base"] == FrameRef("body", "body")
    assert set(task.frames) == {"base", "object"}
    other = {"base": FrameRef("body", "box"), "object": FrameRef("body", "box")}
    assert bare(move_box, frames=other).frames["base"] == FrameRef("body", "box")


def test_trails_are_of_the_gripper_and_what_is_moved(move_box):
    assert move_box.trails == ("gripper", "object")
    assert bare(move_box).trails == ("object",)
    assert bare(move_box, frames={}, goal=None).trails == ("base",)


def test_movers_are_one_frame_an_object_in_the_order_of_the_scene(move_box):
    things = (SceneObject("box", "objects/box.xml"), SceneObject("cone", "objects/cone.xml"))
    frames = {
        "tip": FrameRef("site", "cone/site_object"),
        "cone": FrameRef("body", "cone"),
        "aim": FrameRef("body", "box"),
        "object": FrameRef("body", "box"),
    }
    scene = replace(move_box.scene, objects=things)
    task = bare(move_box, frames=frames, scene=scene)
    assert task.movers == ("aim", "cone")  # a second frame of one body is not a second object
    assert task.goal_frame == "object"
    assert replace(task, goal=(1.0, 2.0, 3.0)).goal_frame == "aim"
    assert bare(move_box, frames={}, goal=None).goal_frame == "base"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"goal": Goal("lid", 0.1)}, "unknown frame of the goal 'lid'; valid: base, object"),
        ({"parameters": ()}, r"its Goal needs a parameter `goal` of \(x, y\)"),
        ({"parameters": (Parameter("goal", 1.0),)}, "its Goal needs a parameter `goal`"),
        ({"parameters": (Parameter("goal", (0.0,) * 3),)}, "its Goal needs a parameter `goal`"),
        ({"goal": (1.0, 2.0)}, r"goal must be \(x, y, z\), got \(1.0, 2.0\)"),
        ({"controller": "autopilot"}, "unknown controller 'autopilot'; valid: joint-targets, pol"),
    ],
)
def test_bad_declarations_say_what_is_valid(move_box, change, message):
    with pytest.raises(UsageError, match=message):
        bare(move_box, **change)


def test_two_parameters_of_one_name_are_refused(move_box):
    with pytest.raises(UsageError, match=r"parameters need distinct names, got \['a', 'a'\]"):
        _ = bare(move_box, goal=None, parameters=(Parameter("a", 1.0),) * 2).table


def test_the_place_of_a_goal(move_box):
    p = move_box.table.named(move_box.table.adjusted((), ("goal=1,-2",)).parameters)
    assert move_box.goal_position(p).tolist() == [1.0, -2.0, 0.254]
    fixed = replace(move_box, goal=(3.0, 4.0, 5.0))
    assert fixed.goal_position(p).tolist() == [3.0, 4.0, 5.0]
    assert replace(move_box, goal=None).goal_position(p) is None


def test_a_task_in_words_has_its_parameters(move_box):
    text = str(move_box)
    assert "goal                       0,0  -8, 8 m" in text
    assert "success_radius             0.1  0, 1 m" in text
    assert "parameter" not in str(bare(move_box, goal=None, parameters=()))


@pytest.mark.parametrize("name", task_names())
def test_every_tasks_numbers_survive_as_texts(name):
    table = load_task(name).table
    assert table.texts(table.defaults) == ((), ())
    weights = [f"{term}={i + 0.1}" for i, term in enumerate(table.terms)]
    changed = table.adjusted(weights, ())
    assert np.array_equal(changed.weights, 0.1 + np.arange(len(table.terms)))
    assert table.adjusted(*table.texts(changed)).same(changed)


def test_a_task_may_state_settings_of_its_planner(move_box):
    assert move_box.planner == {}
    task = replace(move_box, planner={"horizon": 2, "optimizer": "icem"})
    assert "planner         horizon=2, optimizer=icem" in str(task)


@pytest.mark.parametrize(
    ("planner", "message"),
    [
        (
            {"horizn": 2.5},
            "task 'spot/move_box': planner: unknown setting 'horizn'; valid: .*horizon",
        ),
        ({"horizon": 2.51}, "task 'spot/move_box': planner: horizon must be a multiple of 0.02 s"),
        ({"nodes": 0}, "planner: nodes must be from 1 to 100, got 0"),
        ({"nodes": "5"}, "planner: setting nodes needs a value of type int, got '5'"),
        ({"rollouts": 2, "iterations": 3}, "planner: 3 iterations need at least as many rollouts"),
        (["horizon=2.5"], "planner must be settings by name, such as"),
        ("horizon=2.5", "planner must be settings by name, such as"),
        (None, "planner must be settings by name, such as"),
    ],
)
def test_wrong_settings_are_refused_where_the_task_is_made(move_box, planner, message):
    with pytest.raises(UsageError, match=message):
        replace(move_box, planner=planner)


@pytest.mark.parametrize("name", [name for name in task_names() if name.startswith("g1/")])
def test_g1s_tasks_are_run_as_they_were_measured(name):
    planner = PlannerConfig.resolve(load_task(name).planner)
    assert planner == PlannerConfig("cem", horizon=2.5, nodes=7, base_noise=1.0)


GUIDED = PlannerConfig(guidance="object")


def test_a_goal_is_for_the_object_that_its_frame_is_a_part_of(move_box):
    assert move_box.goal_object == "box"
    frames = {**move_box.frames, "corner": FrameRef("site", "box/corner")}
    assert replace(move_box, frames=frames, goal=Goal("corner", 0.0)).goal_object == "box"
    assert replace(move_box, goal=(1.0, 2.0, 0.0)).goal_object == "box"
    assert replace(move_box, goal=Goal("gripper", 0.0)).goal_object == ""
    assert load_task("g1/door_open").goal_object == load_task("spot/upright_box").goal_object == ""


@pytest.mark.parametrize(
    ("name", "changes", "why"),
    [
        ("spot/upright_box", {}, "it has no goal"),
        ("g1/door_open", {}, "its goal is for 'base', which is no object that moves freely"),
        ("spot/move_box", {"goal": None}, "it has no goal"),
        ("spot/move_box", {"goal": Goal("gripper", 0.0)}, "its goal is for 'gripper', which is no"),
        ("spot/move_box", {"actions": joint_actions(SPOT)}, "its actions do not search the base's"),
    ],
)
def test_guidance_needs_an_object_with_a_goal_and_a_base(name, changes, why):
    task = replace(load_task(name), **changes)
    task.check_settings(PlannerConfig())
    with pytest.raises(UsageError, match=f"^guidance=object is not for task '{name}': {why}"):
        task.check_settings(GUIDED)
    with pytest.raises(UsageError, match=f"task '{name}': planner: guidance=object is not for"):
        replace(task, planner={"guidance": "object"})


def test_a_base_that_cannot_walk_sideways_is_not_guided(move_box):
    actions = move_box.actions
    lower, upper = actions.lower.copy(), actions.upper.copy()
    lower[1] = upper[1] = 0.0
    task = replace(move_box, actions=replace(actions, lower=lower, upper=upper))
    with pytest.raises(UsageError, match="do not search the base's velocities x, y and yaw"):
        task.check_settings(GUIDED)


def test_a_task_may_state_its_guidance(move_box):
    task = replace(move_box, planner={"guidance": "object"})
    assert PlannerConfig.resolve(task.planner) == GUIDED
