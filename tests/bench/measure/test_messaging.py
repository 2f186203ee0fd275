import json
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from sumo_dist.bench.measure import messaging
from sumo_dist.bench.measure.planning import in_process, request
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.cli import main
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError
from sumo_dist.planner.config import PlannerConfig

SMALL = EpisodeConfig("spot/move_box", planner=PlannerConfig(rollouts=4, horizon=0.1))


def test_requests_differ_in_nothing_but_their_number():
    episode, snapshot = Episode.assemble(SMALL), Snapshot.load()
    first, second = request(episode, snapshot, 1), request(episode, snapshot, 2)
    assert (first.number, second.number) == (1, 2)
    assert first.tick < second.tick
    assert np.array_equal(first.state, second.state)
    assert first.cost.same(second.cost)
    with in_process(episode, threads=1) as plan:
        assert not np.array_equal(plan(first).plan.knots, plan(second).plan.knots)


def test_plans_that_differ_are_no_comparison():
    episode, other = Episode.assemble(SMALL), Episode.assemble(replace(SMALL, seed=1))
    questions = (request(episode, Snapshot.load(), number) for number in count(1))
    with (
        in_process(episode, threads=1) as here,
        in_process(other, threads=1) as there,
        pytest.raises(SumoError, match="plan 1 differs"),
    ):
        messaging.interleave(questions, here, there, plans=1)


def test_figures_are_percentiles_and_differences():
    here = [messaging.Sample(plan, 1.0) for plan in (10.0, 11.0, 12.0)]
    there = [messaging.Sample(plan, 2.0) for plan in (14.0, 12.0, 30.0)]
    found = messaging.figures(here, there, ("in_process", "services"))
    assert (found["in_process_plan_ms_p50"], found["services_plan_ms_p50"]) == (11.0, 14.0)
    assert found["added_ms_p50"] == 3.0
    assert found["services_own_ms_p99"] == 2.0


@pytest.mark.slow
def test_the_services_make_the_same_plans(capsys):
    assert main(["bench", "messaging", "--json", "--plans", "3"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["plans"] == 3
    assert 0 < found["services_own_ms_p50"] < found["services_plan_ms_p50"]


@pytest.mark.slow
def test_services_with_keys_make_the_same_plans(capsys):
    assert main(["bench", "messaging", "--tls", "--plans", "3", "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert "without keys and with them" in said
    assert "added by TLS and the access list" in said


@pytest.mark.parametrize("option", ["plans", "workers"])
def test_bad_options_are_named(capsys, option):
    assert main(["bench", "messaging", f"--{option}", "0"]) == 2
    assert f"{option} must be at least 1" in capsys.readouterr().err
