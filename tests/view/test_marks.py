import numpy as np
import pytest

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.tasks import load_task
from sumo_dist.view.marks import eye_azimuth, goal_rings, ranked, way_colors


def luminance(colors):
    return colors.astype(float) @ [0.2126, 0.7152, 0.0722]


def test_cheaper_is_brighter_whatever_the_scale():
    costs = np.array([3.0, 1.0, 2.0, 1e9, 0.5])
    elites, others, shades = ranked(costs, PlannerConfig(elites=1))
    assert list(elites) == [4]
    assert list(others) == [3, 0, 2, 1]  # the worst first: better ones are drawn over it
    brightness = luminance(shades)
    assert np.all(np.diff(brightness) > 10)
    assert brightness[0] < 30


def test_only_candidates_with_a_cost_are_drawn():
    costs = np.array([np.inf, 2.0, np.inf, 1.0, 3.0, 4.0])
    elites, others, _ = ranked(costs, PlannerConfig("cem", elites=3))
    assert list(elites) == [3, 1, 4]
    assert list(others) == [5]
    elites, others, shades = ranked(np.full(4, np.inf), PlannerConfig())
    assert len(elites) == len(others) == len(shades) == 0


def test_predictive_sampling_has_one_best():
    elites, others, _ = ranked(np.arange(6.0), PlannerConfig(optimizer="ps", elites=3))
    assert (len(elites), len(others)) == (1, 5)


def test_rings_are_closed_and_lie_on_the_floor_around_the_goal():
    rings = goal_rings(np.array([1.0, 2.0, 0.5]))
    assert np.allclose(rings[:, 0], rings[:, -1])
    assert np.allclose(rings.mean(axis=(0, 1))[:2], [1.0, 2.0], atol=0.01)
    assert np.all((rings[..., 2] > 0) & (rings[..., 2] < 0.02))


@pytest.mark.parametrize("side", np.deg2rad(np.arange(0.0, 360.0, 15.0)))
def test_the_robot_is_not_behind_what_it_stands_before(side):
    robot, target = np.array([3.0, 1.0, 0.8]), np.array([3.0, 1.0, 0.4])
    robot[:2] += 1.2 * np.array([np.cos(side), np.sin(side)])
    eye = np.deg2rad(eye_azimuth(robot, target))
    assert np.cos(eye - side) > -0.51


def test_a_robot_that_is_alone_is_seen_from_the_usual_side():
    here = np.array([1.0, 2.0, 0.5])
    assert eye_azimuth(here, here) == -55.0


def test_ways_are_of_the_robot_and_of_every_object_each_in_its_colour(two_objects):
    colors = way_colors(two_objects)
    assert list(colors) == ["base", "object", "cone"]
    assert len(set(colors.values())) == 3
    alone = way_colors(load_task("spot/move_box"))
    assert alone == {name: colors[name] for name in ("base", "object")}
    assert list(way_colors(load_task("g1/door_open"))) == ["base"]
