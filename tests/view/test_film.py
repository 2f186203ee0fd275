from copy import deepcopy

import imageio.v2 as imageio
import numpy as np
import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.record.rows import Rows
from sumo_dist.view.replay import render


def shows(picture, color, tolerance):
    """Number of pixels whose colour is near one."""
    return int((np.abs(picture[..., :3].astype(int) - color).max(axis=-1) < tolerance).sum())


@pytest.fixture(scope="module")
def film(short_run, tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "run.gif"
    try:
        render(short_run, path)
    except SumoError as error:
        if "no graphics library" in str(error):
            pytest.skip(str(error))
        raise
    return imageio.mimread(path)


def test_a_film_has_a_picture_of_every_fourth_tick(film, short_run):
    assert len(film) == -(-len(short_run.states) // 4)
    assert film[0].shape[:2] == (360, 640)


def test_robot_and_goal_are_in_every_picture_and_the_picture_changes(film):
    for picture in film:
        assert shows(picture, (250, 190, 20), 60) > 100  # the robot's yellow
        assert shows(picture, (64, 224, 140), 45) > 50  # the goal's rings
    changed = np.abs(film[0].astype(int) - film[-1]).max(axis=-1) > 40
    assert changed.sum() > 200


def test_a_strip_has_the_start_on_its_left_and_the_end_on_its_right(short_run, film, tmp_path):
    path = tmp_path / "strip.jpg"
    render(short_run, path)
    strip = imageio.imread(path)
    assert strip.shape == (175, 6 * 280, 3)
    pictures = np.split(strip.astype(int), 6, axis=1)
    assert all(shows(picture, (250, 190, 20), 60) > 20 for picture in pictures)
    steps = [np.abs(a - pictures[0]).mean() for a in pictures]
    assert steps[0] == 0
    assert min(steps[1:]) > 0.2


def test_two_futures_are_drawn_from_where_they_part_to_the_end_of_the_longer(
    short_run, film, tmp_path
):
    """The other one is red, and beside the run."""
    other = deepcopy(short_run)
    states = np.array(short_run.states)
    states[12:, :2] += [0.8, 0.8]
    other.states = Rows(states)
    shorter = deepcopy(short_run)
    shorter.cut(16, 6)
    path = tmp_path / "both.gif"
    render(shorter, path, (other, 12))
    pictures = imageio.mimread(path)
    assert len(pictures) == -(-(26 - 12) // 4)
    for picture in pictures:
        red = picture[..., 0].astype(int) - picture[..., 2]
        assert (red > 60).sum() > shows(film[0], (250, 190, 20), 60)  # more than the robot alone
        assert shows(picture, (250, 190, 20), 60) > 100


def test_an_unknown_format_names_those_there_are(short_run, tmp_path):
    with pytest.raises(UsageError, match=r"\.gif, \.jpg, \.mp4, \.webp"):
        render(short_run, tmp_path / "run.avi")


def test_without_graphics_the_error_says_what_was_tried(short_run, tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(SumoError, match=r"no graphics library.*disable"):
        render(short_run, tmp_path / "run.gif")


def test_a_place_that_cannot_be_written_to_is_an_error(short_run, tmp_path):
    with pytest.raises(SumoError, match=r"cannot render .*no/run.gif"):
        render(short_run, tmp_path / "no" / "run.gif")
