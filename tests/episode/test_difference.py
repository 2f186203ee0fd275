from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.difference import first_difference
from sumo_dist.record.rows import Rows
from sumo_dist.record.world import World


@pytest.fixture(scope="module")
def world(short_run):
    return World.of(short_run)


def changed(recording, **places):
    """Add 1 to numbers of a recording, each a row and place of a field."""
    copies = {}
    for field, place in places.items():
        rows = np.array(getattr(recording, field))
        rows[place] += 1
        copies[field] = Rows(rows)
    return replace(recording, **copies)


def test_equal_recordings_do_not_differ(short_run, world):
    assert first_difference(short_run, deepcopy(short_run), world) is None


def test_the_earliest_is_named_and_within_a_tick_what_the_rest_follows_from(short_run, world):
    other = changed(short_run, states=(9, 0), knots=(3, 2, 1), terms=(3, 0), targets=(7, 0))
    found = first_difference(short_run, other, world)
    assert (found.tick, found.plan, found.what) == (7, 3, "terms")
    assert "plan 3: the cost term of the plan before noise, goal was" in found.text


@pytest.mark.parametrize(
    ("field", "place", "name"),
    [
        ("states", (4, 26), "object.x"),
        ("estimates", (4, 3), "body.qw [1]"),
        ("memories", (4, 0), "the policy's memory at 0"),
        ("parameters", (2, 1), "goal[1]"),
        ("actions", (4, 2), "the action base_wz"),
    ],
)
def test_numbers_have_names(short_run, world, field, place, name):
    text = first_difference(short_run, changed(short_run, **{field: place}), world).text
    assert name.replace("object", "box") in text
    assert "(off by 1)" in text


def test_a_run_that_is_longer_differs_in_its_length(short_run, world):
    other = deepcopy(short_run)
    other.cut(20, 8)
    found = first_difference(short_run, other, world)
    assert found.text.startswith("there were 26 states and are 20 now")
