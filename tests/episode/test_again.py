"""A recorded episode from an instant on: as it was, and with other numbers."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.again import Change, repeat, what_if
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.record.recording import Recording
from sumo_dist.record.rows import Rows

SMALL = PlannerConfig(rollouts=4, horizon=0.2)


def digests(recording):
    return recording.plan_digest, recording.state_digest


def again(recording, tmp_path):
    """Return a recording as it comes from the disk."""
    recording.save(tmp_path / "run.npz")
    return Recording.load(tmp_path / "run.npz")


@pytest.fixture(scope="module")
def plain(script_of):
    return script_of()


@pytest.fixture(scope="module")
def script_of():
    """Return a function that runs 0.3 s with an operator's commands."""

    def run(operator=None, task="spot/move_box", time_limit=0.3, **changes):
        config = EpisodeConfig(task, 1, SMALL, time_limit=time_limit, **changes)
        return run_single(config, 1, operator=operator)[0]

    return run


@pytest.mark.parametrize("tick", [0, 1, 5, 6, 15])
def test_without_a_change_the_future_is_the_recorded_one(plain, tick):
    """At plans and between them, at the start and at the end."""
    future, ending = what_if(plain, Change(tick))
    assert digests(future) == digests(plain)
    assert ending.reason == plain.ending
    for name in ("estimates", "memories", "costs", "terms", "traces", "actions", "targets"):
        assert np.array_equal(getattr(future, name), getattr(plain, name)), name
    assert future.commands == plain.commands


@pytest.mark.parametrize(
    ("task", "plant", "estimator"),
    [("spot/upright_rack", "hard", "lowpass"), ("g1/door_open", "perturbed", "truth")],
)
def test_plant_noise_and_estimator_are_at_the_instant_as_they_were(
    script_of, tmp_path, task, plant, estimator
):
    run = again(script_of(task=task, plant=plant, estimator=estimator), tmp_path)
    assert digests(what_if(run, Change(8))[0]) == digests(run)
    other, _ = what_if(run, Change(8, seed=4))
    assert np.array_equal(other.states[:9], run.states[:9])
    assert not np.array_equal(other.costs[-1], run.costs[-1])
    assert digests(repeat(again(other, tmp_path))) == digests(other)


def test_commands_of_an_operator_are_given_again_on_both_sides(script, script_of):
    said = {"t3": [["weight gripper=-50"]], "t9": [["planner rollouts=3"]]}
    run = script_of(script(**said, t12=[["pause", "step 2", "resume"]]))
    for tick in (3, 4, 9, 10):
        assert digests(what_if(run, Change(tick))[0]) == digests(run)


def test_a_number_that_is_changed_stays_so(script, script_of):
    run = script_of(script(t9=[["weight gripper=-50", "weight goal=9"]]))
    future, _ = what_if(run, Change(5, weight=("gripper=7",)))
    weights = np.array(future.weights)
    later = np.array(future.plan_ticks) >= 9
    assert weights[later][:, :2].tolist() == [[9.0, 7.0]] * int(later.sum())
    assert weights[0, :2].tolist() == [60.0, 4.0]


def test_what_ended_the_recorded_run_does_not_end_another_future(script, script_of):
    run = script_of(script(t9=[["stop enough"]]))
    assert run.ending.startswith("stopped by ann")
    same, _ = what_if(run, Change(5))
    assert (digests(same), same.ending) == (digests(run), run.ending)
    other, ending = what_if(run, Change(5, seed=3))
    assert ending.reason == "timeout"
    assert len(other.states) == 16


def test_an_interrupted_run_goes_on(script, script_of):
    run = script_of(script(t9=[[KeyboardInterrupt()]]))
    assert run.ending == "interrupted"
    future, ending = what_if(run, Change(5))
    assert ending.reason == "timeout"
    assert np.array_equal(future.states[:10], run.states)


def test_a_seed_counts_from_its_instant_and_of_a_future_of_a_future_too(plain, tmp_path):
    first, _ = what_if(plain, Change(5, seed=7))
    second, _ = what_if(again(first, tmp_path), Change(10, seed=8))
    third, _ = what_if(again(second, tmp_path), Change(12))
    assert np.array_equal(second.knots[:4], first.knots[:4])
    assert digests(third) == digests(second) != digests(first)
    for run in (first, second, third):
        assert digests(repeat(again(run, tmp_path))) == digests(run)
    earlier, _ = what_if(again(second, tmp_path), Change(0, seed=1))
    assert digests(earlier) == digests(plain)


def test_a_plan_that_lost_candidates_is_taken_as_it_is(plain):
    """Nobody knows which they were: the run after it is what must repeat."""
    lost = np.array(plain.lost)
    lost[2] = 1
    knots = np.array(plain.knots)
    knots[2, 2:] *= 0.5
    run = replace(plain, lost=Rows(lost), knots=Rows(knots))
    found = repeat(run)
    assert np.array_equal(found.knots[2], knots[2])
    assert not np.array_equal(found.states[-1], plain.states[-1])


def test_a_run_without_traces_has_those_of_its_new_future(plain):
    future, _ = what_if(replace(plain, traces=Rows(), plan_cpu_ms=Rows()), Change(5))
    seen = [future.seen(i) for i in range(len(future.plan_numbers))]
    assert seen == [tick >= 5 for tick in future.plan_ticks]


def test_a_past_that_cannot_be_is_an_error(plain):
    states = np.array(plain.states)
    states[3, 0] += 1e-9
    with pytest.raises(SumoError, match=r"do not lead to the recorded states at 0\.1 s"):
        what_if(replace(plain, states=Rows(states)), Change(5))


def test_an_instant_outside_of_the_run_is_refused(plain):
    with pytest.raises(UsageError, match=r"there is no 0.32 s in this run; valid: from 0 to 0.3"):
        what_if(plain, Change(16))
