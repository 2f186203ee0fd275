"""The search finds what is better, gives up what is hopeless, and goes on where it was."""

import pytest

from sumo_dist.bench.campaign.campaign import TrialSettings
from sumo_dist.bench.tune.results import COMPLETE, PRUNED, RUNNING, best, tried
from sumo_dist.bench.tune.search import Search
from sumo_dist.bench.tune.space import Space
from sumo_dist.tasks import load_task

SEEDS = (1, 2, 3, 4)
SPACE = Space.of(
    load_task("spot/move_box"),
    TrialSettings(set=("rollouts=4:64", "optimizer=ps:cem:icem")),
    ("goal", "gripper"),
)


def outcome(values, seed):
    """An episode as it might go: faster with more of one weight, unsolved with less of another."""
    solved = values["weight gripper"] * 20 > values["weight goal"] / 4 or seed % 2
    slow = 25.0 - 2 * (values["set optimizer"] == "cem") - values["set rollouts"] / 4
    time = min(29.0, slow * 60 / values["weight goal"] + seed)
    return {"success": bool(solved), "completion_time_s": time, "time_limit_s": 30.0, "cpu_s": 1.0}


def search(rows=(), trials=25, seed=0, own=False, first=2):
    return Search(SPACE, SEEDS, first, trials, seed, own=own, found=tried(rows))


def drive(going, rows=(), until=10**6, beside=1):
    """Run what is asked for, some questions at a time, up to so many rows; return all rows."""
    rows, running = list(rows), []
    while len(rows) < until:
        while len(running) < beside and (question := going.next()):
            running.append(question)
        if not running:
            break
        question = running.pop(0)
        row = {"task": "t", "seed": question.seed, **outcome(question.values, question.seed)}
        state = going.take(question, row)
        about = {"trial": question.number, "values": question.values, "asked": question.asked}
        rows.append({**row, **about, "state": state})
    return rows


@pytest.fixture(scope="module")
def whole():
    return drive(search())


def test_it_finds_better_ones_and_prunes_hopeless_ones(whole):
    trials = tried(whole)
    assert len(trials) == 25
    states = [trial.state for trial in trials]
    assert states[:5] == [COMPLETE] * 5  # whose median the others are compared with
    assert PRUNED in states and RUNNING not in states
    for trial in trials:
        assert len(trial.rows) == (4 if trial.state == COMPLETE else 2)
    early, late = best(trials[:10]), best(trials)
    assert early is not None and late is not None
    assert late.loss < early.loss
    assert late.solved == 4


def test_the_same_seed_tries_the_same_and_another_does_not(whole):
    assert drive(search()) == whole
    assert drive(search(seed=1))[0]["values"] != whole[0]["values"]


@pytest.mark.parametrize("cut", [1, 3, 17, 40, 55])
def test_a_search_that_goes_on_tries_what_it_would_have_tried(whole, cut):
    rows = drive(search(), until=cut)
    assert rows == whole[:cut]
    assert drive(search(rows), rows) == whole


def test_a_longer_search_goes_on_from_a_shorter_one(whole):
    rows = drive(search(trials=9))
    assert rows == whole[: len(rows)]
    assert drive(search(rows, trials=25), rows) == whole


def test_trials_side_by_side_are_all_run_and_go_on_after_a_kill():
    rows = drive(search(), until=20, beside=3)
    rows = drive(search(rows), rows, beside=3)
    trials = tried(rows)
    assert [trial.number for trial in trials] == list(range(25))
    assert RUNNING not in {trial.state for trial in trials}
    seeds = [[row["seed"] for row in trial.rows] for trial in trials]
    assert all(tuple(of_it) == SEEDS[: len(of_it)] for of_it in seeds)


def test_the_first_trial_is_the_tasks_own_if_that_is_asked_for(whole):
    rows = drive(search(own=True), until=9)
    assert rows[0]["values"] == SPACE.start
    assert whole[0]["values"] != SPACE.start
    assert drive(search(rows, own=True), rows, until=30) == drive(search(own=True), until=30)


def test_with_as_many_first_seeds_as_there_are_nothing_is_pruned():
    trials = tried(drive(search(trials=12, first=4)))
    assert {trial.state for trial in trials} == {COMPLETE}


def test_what_cannot_be_together_is_left_out():
    going = search(trials=3)
    for _ in range(3):
        question = going.next()
        assert question is not None
        going.drop(question)
    assert going.next() is None


def test_importances_are_shares_of_what_is_searched(whole):
    found = search(whole).importances()
    assert set(found) == {d.name for d in SPACE.dimensions}
    assert sum(found.values()) == pytest.approx(1.0)
    assert search(whole[:8]).importances() == {}
