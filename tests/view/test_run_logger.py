"""A run as entities, of tasks that have more, or less, than one object and a goal."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks.reset import Start
from sumo_dist.view.marks import ON_FLOOR, way_colors
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.rrd_file import RrdFile
from sumo_dist.view.run_logger import RunLogger
from sumo_dist.view.trail_log import TRAIL_TICKS


def logged(task, states, path, read_rrd, **config):
    episode = EpisodeConfig("spot/move_box", **config)
    with Outputs("test", RrdFile(path, pytest.fail)) as out:
        logger = RunLogger(out, task, episode, distributed=False)
        for tick, state in enumerate(states):
            logger.log_state(tick, state)
        logger.flush()
    return read_rrd(path)


@pytest.fixture(scope="module")
def sliding(two_objects):
    """Half a second in which the box goes along x and the cone along y."""
    index = StateIndex(compile_model(two_objects.scene, PLANT))
    level = np.array([1.0, 0.0, 0.0, 0.0])
    things = {"box": (np.array([2.0, 0, 0.254]), level), "cone": (np.array([0, 2.0, 0]), level)}
    state = Start.of(two_objects.scene).place(np.zeros(2), 0.0, things)
    states = []
    for tick in range(TRAIL_TICKS + 1):
        states.append(state.copy())
        states[-1][index.pose("box")][0] += 0.01 * tick
        states[-1][index.pose("cone")][1] += 0.02 * tick
    return states


def test_each_object_leaves_a_way_of_its_own_colour(two_objects, sliding, tmp_path, read_rrd):
    rrd = logged(two_objects, sliding, tmp_path / "run.rrd", read_rrd)
    ways = {n: rrd.timed[f"/world/trail/{n}"] for n in ("base", "object", "cone")}
    last = 0, TRAIL_TICKS
    expected = {
        "object": [[2.0 + 0.01 * tick, 0.0, ON_FLOOR] for tick in last],
        "cone": [[0.0, 2.0 + 0.02 * tick, ON_FLOOR] for tick in last],
    }
    for name, points in expected.items():
        assert np.allclose(ways[name]["LineStrips3D:strips"][-1], [points], atol=1e-6)
    shown = {name: way["LineStrips3D:colors"][-1][0] >> 8 for name, way in ways.items()}
    wanted = {n: int.from_bytes(bytes(c), "big") for n, c in way_colors(two_objects).items()}
    assert shown == wanted
    assert len(set(shown.values())) == 3


def test_the_distance_is_of_what_has_the_goal(two_objects, sliding, tmp_path, read_rrd):
    goal = replace(two_objects.goal, frame="cone", z=0.0)
    task = replace(two_objects, goal=goal, success=lambda r: r.cone.pos[..., 2] > 1.0)
    rrd = logged(task, sliding, tmp_path / "a.rrd", read_rrd, param=("goal=0,1.5",))
    shown = np.array(rrd.timed["/plots/progress/goal"]["Scalars:scalars"])[:, 0]
    assert shown == pytest.approx(0.5 + 0.02 * np.arange(len(sliding)))
    assert rrd.static["/plots/progress/goal"]["SeriesLines:names"] == [["cone to goal"]]


def test_a_task_without_a_goal_draws_none(two_objects, sliding, tmp_path, read_rrd):
    rrd = logged(replace(two_objects, goal=None), sliding, tmp_path / "a.rrd", read_rrd)
    assert not [entity for entity in rrd.timed if "goal" in entity]
    assert "/plots/progress/goal" not in rrd.timed
    assert "green target" not in rrd.static["/about/scene"]["TextDocument:text"][0][0]
