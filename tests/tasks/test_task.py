from dataclasses import replace

import pytest

from sumo_dist.errors import UsageError
from sumo_dist.tasks import load_task, task_names


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
    with pytest.raises(UsageError, match=r"frames lack \['base', 'wheel'\]"):
        frames = {name: ref for name, ref in move_box.frames.items() if name != "base"}
        replace(move_box, frames=frames, trails=("gripper", "wheel"))
