import numpy as np
import pytest

from sumo_dist.bench.measure.latency import DelayedTrial, LatePlanner, rows, run, text
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.planner.config import PlannerConfig

QUICK = PlannerConfig(rollouts=6, horizon=0.4)
EPISODE = EpisodeConfig("spot/move_box", 1, QUICK, time_limit=0.3)


@pytest.fixture(scope="module")
def episode():
    return Episode.assemble(EPISODE)


def followed(episode, periods, compensate, ticks=12):
    """Ticks of the anchors of the plans that are followed, tick by tick."""
    state, memory = episode.body.truth, episode.controller.initial_memory()
    with episode.problem.engine(1) as engine:
        late = LatePlanner(DelayedTrial(EPISODE, periods, compensate), episode, engine)
        anchors = []
        for tick in range(ticks):
            late.action(tick, state, memory)
            plan = late._follower.plan
            anchors.append(None if plan is None else plan.tick)
    return anchors


def test_without_delay_each_plan_is_followed_at_once(episode):
    assert followed(episode, 0, False, 8) == [0, 0, 2, 2, 2, 5, 5, 7]


def test_a_late_plan_keeps_the_anchor_of_its_state(episode):
    assert followed(episode, 2, False) == [*[None] * 5, 0, 0, 2, 2, 2, 5, 5]


def test_a_compensated_plan_is_made_for_its_arrival(episode):
    assert followed(episode, 2, True) == [*[None] * 5, 5, 5, 7, 7, 7, 10, 10]


@pytest.mark.slow
def test_without_delay_it_is_the_lockstep_run():
    recording, ending = run_single(EPISODE, threads=1)
    assert run(DelayedTrial(EPISODE, 0, False)) == (ending.reason, pytest.approx(0.3))
    assert len(recording.states) == 16


def test_rows_are_counted_and_laid_out():
    late, fixed = DelayedTrial(EPISODE, 2, False), DelayedTrial(EPISODE, 2, True)
    counted = rows([(late, "fell", 3.0), (fixed, "success", 7.0), (fixed, "success", 9.0)])
    assert [row["successes"] for row in counted] == [0, 2]
    assert counted[1]["median_s"] == 8.0
    about = {"engine": "e", "task": "t", "plant": "nominal", "trials": 1, "seed0": 1}
    _, table = text({**about, "rows": counted})
    assert "| 100        | with         | 2/2" in table
    assert np.char.count(table, "fell") == 1
