"""The world that a recording carries, with its task there, changed or gone."""

import json
from dataclasses import replace
from fractions import Fraction

import mujoco
import numpy as np
import pytest

from sumo_dist.costs.view import ViewLayout
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.record.world import World, description, saved, unchanged_task
from sumo_dist.tasks import load_task, task_names


def gone(recording):
    """The recording of a task that is not here any more."""
    episode = {**recording.config["episode"], "task": "/gone/my_task.py"}
    return replace(recording, config={**recording.config, "episode": episode})


def test_the_model_is_the_plants_to_the_last_bit(short_run, move_box):
    assert saved(World.of(short_run).model) == saved(compile_model(move_box.scene, PLANT))


def test_a_task_that_is_as_it_was_has_its_functions(short_run, move_box, first_state):
    world = World.of(short_run)
    data = mujoco.MjData(world.model)
    data.qpos[:] = first_state[: world.model.nq]
    mujoco.mj_kinematics(world.model, data)
    view = ViewLayout(world.model, world.task.frames).at(
        data, len(world.task.actions.names), world.task.table.named(short_run.parameters[0])
    )
    assert bool(world.task.success(view)[0, 0]) is False
    unknown = World.of(gone(short_run)).task
    assert np.isnan(unknown.success(view)).all()
    assert np.isnan(unknown.cost[0].residual(view)).all()
    with pytest.raises(SumoError, match="carries no functions"):
        unknown.reset(np.random.default_rng(0), None)


@pytest.mark.parametrize("name", task_names())
def test_of_a_task_that_is_gone_all_is_there_but_its_functions(name, short_run):
    task = load_task(name)
    model = saved(compile_model(task.scene, PLANT))
    config = {**short_run.config, "task": json.loads(json.dumps(description(task)))}
    world = World.of(gone(replace(short_run, config=config, model=model)))
    assert saved(world.model) == model
    for part in ("name", "parameters", "goal", "goal_frame", "movers", "trails", "time_limit"):
        assert getattr(world.task, part) == getattr(task, part), part
    assert dict(world.task.frames) == dict(task.frames)
    assert world.task.scene.robot == task.scene.robot
    assert str(task).startswith(str(world.task))  # settings are those of the recording
    numbers = task.table.defaults.parameters
    goals = [each.goal_position(each.table.named(numbers)) for each in (task, world.task)]
    assert np.array_equal(*goals)


def test_a_description_is_json_whatever_numbers_a_task_is_made_of(move_box):
    parameter = replace(move_box.parameters[0], default=np.array([0.5, 1.0], np.float32))
    term = replace(move_box.cost[0], weight=np.float32(3))
    task = replace(
        move_box,
        parameters=(parameter, *move_box.parameters[1:]),
        cost=(term, *move_box.cost[1:]),
        time_limit=np.int64(4),
        success_hold=Fraction(1, 2),
    )
    described = description(task)
    assert json.loads(json.dumps(described)) == described
    assert described["parameters"][0]["default"] == [0.5, 1.0]
    assert (described["time_limit"], described["success_hold"]) == (4, 0.5)


def test_without_a_model_the_task_must_be_as_it_was(short_run, move_box):
    old = replace(short_run, model=b"")
    assert saved(World.of(old).model) == saved(compile_model(move_box.scene, PLANT))
    with pytest.raises(UsageError, match="the task of this recording is not here as it was: "):
        World.of(gone(old))
    other = replace(old, config={**old.config, "task_hash": "0123"})
    with pytest.raises(UsageError, match=r"has changed since this run: its hash was 0123 and is"):
        World.of(other)
    with pytest.raises(UsageError, match="has changed"):
        unchanged_task(other)


def test_another_mujoco_and_a_broken_model_are_one_line(short_run):
    versions = {**short_run.config["versions"], "mujoco": "3.6.0"}
    with pytest.raises(UsageError, match=r"made with MuJoCo 3\.6\.0, which alone can"):
        World.of(replace(short_run, config={**short_run.config, "versions": versions}))
    for model in (b"x", short_run.model[:-1000], short_run.model[:100], b"\0" * 400_000):
        with pytest.raises(UsageError, match="this recording's model cannot be read"):
            World.of(replace(short_run, model=model))


def test_a_task_of_another_version_is_taken_as_far_as_it_goes_or_refused(short_run):
    described = short_run.config["task"]

    def world(task):
        return World.of(gone(replace(short_run, config={**short_run.config, "task": task})))

    more = {**described, "colour": "red", "robot": {**described["robot"], "wheels": 4}}
    assert str(world(more).task) == str(world(described).task)
    for task in ({**described, "robot": {}}, {"name": "x"}, {**described, "cost": [{}]}, None):
        with pytest.raises(UsageError, match=r"this recording's task cannot be read: .* made it"):
            world(task)


def test_a_model_is_a_small_part_of_a_recording(short_run, tmp_path):
    short_run.save(tmp_path / "with.npz")
    replace(short_run, model=b"").save(tmp_path / "without.npz")
    sizes = [(tmp_path / f"{name}.npz").stat().st_size for name in ("with", "without")]
    assert 0 < sizes[0] - sizes[1] < 50_000
