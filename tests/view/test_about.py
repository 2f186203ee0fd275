"""The text beside the picture speaks of what the task has."""

import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.tasks import load_task
from sumo_dist.view import about


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("spot/move_box", ("the object should come to rest", "the way of robot and object")),
        ("g1/box_push", ("where the robot's base and the object go", "coloured lines")),
        ("g1/door_open", ("the robot should go", "the right palm go", "the way of the robot so")),
    ],
)
def test_it_names_what_there_is(name, said):
    task = load_task(name)
    text = about.scene(task, EpisodeConfig(name), "").lower()
    assert name in text
    for words in said:
        assert words.lower() in text
    assert ("object" in text) == ("object" in task.frames)


def test_every_object_is_named(two_objects):
    text = about.scene(two_objects, EpisodeConfig("spot/move_box"), "")
    assert "not drawn" not in text
    assert "the way of robot and object and cone so far" in text


def test_it_says_what_is_not_drawn(move_box):
    text = about.scene(move_box, EpisodeConfig("spot/move_box"), "skin (1)")
    assert "not drawn: skin (1)" in text


def test_what_the_viewer_has_no_letters_for_is_replaced():
    assert about.legible("Kiste fürs Ziel – 5 ° · “go”") == "Kiste fürs Ziel – 5 ° · “go”"
    assert about.legible("box \U0001f7e6 箱") == "box ? ?"
