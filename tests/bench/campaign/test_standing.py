import numpy as np

from sumo_dist.bench.campaign.job import run_standing
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.tasks import load_task


def test_the_robot_stands_where_it_was_put_and_nobody_plans():
    config = EpisodeConfig("spot/upright_cone", seed=1, time_limit=1.0)
    recording, ending = run_standing(config)
    assert ending.reason == "timeout"
    assert len(recording.states) == 51
    first, last = recording.states[0], recording.states[-1]
    assert np.abs(last[:2] - first[:2]).max() < 0.05  # the base's x and y [m]
    assert 0.4 < last[2] < 0.6
    actions = load_task(config.task).actions
    for knots in recording.knots:
        np.testing.assert_allclose(actions.physical(knots)[0], actions.default, atol=1e-6)


def test_it_starts_where_the_planned_trial_starts():
    config = EpisodeConfig("spot/upright_cone", seed=3, time_limit=0.02)
    planned, _ = run_single(config, threads=1)
    standing, _ = run_standing(config)
    np.testing.assert_array_equal(standing.states[0], planned.states[0])
