"""A recording on disk and back, and plans of which some have more or fewer candidates."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import FORMAT, Recording


def with_operator(recording):
    said = {"tick": 3, "number": 0, "sender": "ann", "verb": "weight", "name": "goal"}
    return replace(recording, operator=[{**said, "value": "5"}], ending="stopped by ann: é")


@pytest.fixture
def saved(short_run, tmp_path):
    with_operator(short_run).save(tmp_path / "run.npz")
    return tmp_path / "run.npz"


def test_all_that_was_recorded_comes_back(short_run, saved):
    again = Recording.load(saved)
    for field in fields(Recording):
        before, now = (getattr(each, field.name) for each in (with_operator(short_run), again))
        if field.name == "config":
            assert now == json.loads(json.dumps(before))
        elif isinstance(before, str | list | dict):
            assert now == before, field.name
        else:
            assert np.array_equal(np.array(now), np.array(before)), field.name
            assert len(now) or field.name == "late_ms", field.name
    assert again.plan_digest == short_run.plan_digest
    assert again.state_digest == short_run.state_digest


def test_a_plan_says_what_it_was_made_with(short_run):
    rows = len(short_run.plan_numbers)
    assert np.array(short_run.weights).tolist() == [[60.0, 4.0, 20.0, 2500.0]] * rows
    assert np.array(short_run.parameters).tolist() == [[0.0, 0.0, 0.1, 0.05]] * rows
    assert list(short_run.config["terms"]) == ["goal", "gripper", "velocity", "fall"]
    assert list(short_run.config["parameters"]) == ["goal", "success_radius", "success_speed"]


def test_a_recording_of_another_format_says_so(saved):
    with np.load(saved) as file:
        parts = dict(file)
    np.savez(saved, **{**parts, "format": np.array(1)})
    with pytest.raises(UsageError, match=f"recording format 1, this is {FORMAT}"):
        Recording.load(saved)


@pytest.mark.parametrize("missing", ["operator", "ending", "config", "format"])
def test_a_recording_that_lacks_something_is_none(saved, missing):
    with np.load(saved) as file:
        parts = {name: value for name, value in file.items() if name != missing}
    np.savez(saved, **parts)
    with pytest.raises(UsageError, match="is not a recording of sumo-dist"):
        Recording.load(saved)


def report(rows, terms=4):
    plan = Plan(0, 0, np.zeros((4, 9), np.float32), 0.2, "linear")
    finite = np.arange(rows) != 1
    numbers = np.zeros(terms), np.ones(terms), np.zeros(4)
    return PlanReport(plan, np.arange(rows, dtype=float), finite, *numbers, 1.0, 1.0)


@pytest.mark.parametrize("rows", [1, 4, 6, 9])
def test_plans_of_any_number_of_candidates_are_kept_side_by_side(short_run, rows):
    recording = Recording(short_run.config)  # of six candidates
    for count in (6, rows):
        recording.add_plan(report(count))
        recording.add_traces(np.full((count, 2, 25, 3), count, np.float32))
    assert list(recording.rollouts) == [6, rows]
    costs, traces = recording.costs[1], recording.traces[1]
    expected = [x if x != 1 else np.inf for x in range(min(rows, 6))]
    assert costs.tolist() == expected + [np.inf] * (6 - len(expected))
    assert traces.shape == (6, 2, 25, 3)
    assert traces.dtype == np.float32
    assert (traces[np.arange(6) < rows] == rows).all()


def test_what_comes_after_is_cut(short_run):
    recording = Recording(short_run.config)
    for tick in range(5):
        recording.add_tick(np.full(3, tick), np.full(3, tick), np.zeros(2))
        recording.add_plan(report(6))
        recording.add_traces(np.zeros((6, 2, 25, 3)))
        recording.plan_cpu_ms.append(1.0)
    recording.cut(3, 2)
    assert [len(x) for x in (recording.states, recording.estimates, recording.memories)] == [3] * 3
    plans = (recording.plan_numbers, recording.weights, recording.costs, recording.traces)
    assert [len(rows) for rows in (*plans, recording.plan_cpu_ms)] == [2] * 5
    recording.cut(9, 9)
    assert (len(recording.states), len(recording.knots)) == (3, 2)
