"""The layouts, as the viewer gets them."""

import numpy as np
import pytest

from sumo_dist.view.blueprint import Eye, layout
from sumo_dist.view.plots import plots

EYE = Eye(np.array([3.0, -3.0, 3.0]), np.array([1.0, 0.0, 0.5]))


def tabs(task, distributed, first="drive"):
    """Names of the tabs, the one that is open, and origins of the views below each."""
    shown = plots(task, distributed, ("robot on floor",))
    root = layout(EYE, EYE, task.movers, shown, distributed, first).root_container
    found = {tab.name: list(origins(tab)) for tab in root.contents}
    return found, list(found)[root.active_tab]


def origins(part):
    for inner in getattr(part, "contents", ()):
        if hasattr(inner, "origin"):
            yield inner.origin
        else:
            yield from origins(inner)


@pytest.mark.parametrize("first", ["drive", "tune", "fleet"])
def test_there_is_a_tab_for_each_purpose_and_one_is_open(move_box, first):
    found, opened = tabs(move_box, True, first)
    assert list(found) == ["drive", "tune", "fleet", "what it means"]
    assert opened == first
    assert all(views[0] == "verdict" for views in found.values())


def test_in_one_process_there_is_no_fleet(move_box):
    found, opened = tabs(move_box, False, "fleet")
    assert list(found) == ["drive", "tune", "what it means"]
    assert opened == "drive"


def test_every_plot_of_a_task_is_somewhere(move_box):
    found, _ = tabs(move_box, True)
    there = {origin for views in found.values() for origin in views}
    for plot in plots(move_box, True, ()).all:
        assert f"plots/{plot.origin}" in there
    assert {"world", "charts/terms", "charts/knots"} <= there


def test_from_above_the_way_runs_from_left_to_right():
    above = Eye(np.array([5.0, 0.0, 5.0]), np.zeros(3)).above(np.array([0.0, 2.0]))
    ahead = above.target - above.position
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    assert right / np.linalg.norm(right) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert np.isfinite(EYE.above(np.zeros(2)).position).all()  # it starts at its goal
