import json

import pytest

from sumo_dist.bench.results.outcomes import JOURNAL, REQUEST, Count, Results
from sumo_dist.errors import UsageError

BOX, CONE = "spot/move_box", "spot/upright_cone"


@pytest.fixture
def folder(tmp_path, make_row):
    """A suite of two tasks and five seeds that lacks two trials."""
    rows = [
        *(make_row(BOX, seed, time) for seed, time in ((4, 9.0), (1, 4.0), (2, 5.0), (6, 1.0))),
        make_row(BOX, 3, reason="fault: the simulation diverged at tick 7"),
        *(make_row(CONE, seed, reason=reason) for seed, reason in ((3, "fell"), (1, "timeout"))),
        *(make_row(CONE, seed, reason=reason) for seed, reason in ((4, "timeout"), (2, "fell"))),
        make_row(CONE, 5, 2.0),
        *(make_row(CONE, seed, variant="standing") for seed in range(1, 5)),
        make_row(CONE, 5, 0.5, variant="standing"),
    ]
    (tmp_path / JOURNAL).write_text("".join(json.dumps(row) + "\n" for row in rows))
    request = {"suite": "paper-analysis", "command": "c", "tasks": [BOX, CONE]}
    (tmp_path / REQUEST).write_text(json.dumps({**request, "trials": 5, "seed0": 1}))
    return tmp_path


def test_trials_are_sorted_by_task_seed_and_variant(folder):
    box, cone = Results.load(folder).tasks
    assert [row["seed"] for row in box.count.rows] == [1, 2, 3, 4]  # 6 was not asked for
    assert (box.count.successes, box.count.median, box.control) == (3, 5.0, None)
    assert [row["seed"] for row in cone.count.rows] == [1, 2, 3, 4, 5]
    assert (cone.count.successes, cone.control.successes, cone.control.trials) == (1, 1, 5)
    assert cone.figure[:2] == (20, 20)


def test_what_is_missing_is_counted(folder):
    assert Results.load(folder).missing == 1
    request = json.loads((folder / REQUEST).read_text())
    (folder / REQUEST).write_text(json.dumps({**request, "trials": 7}))
    results = Results.load(folder)  # seed 6 of the box now counts
    assert results.missing == 7 * 3 - 15
    assert results.findings()[-1].startswith("Unfinished: 6 trials")


def test_findings_say_what_the_table_says(folder):
    first, second, *_ = Results.load(folder).findings()
    assert first.startswith("4 of 9 trials succeeded")
    assert "rates is 0.475, published 0.925; 0 of 2 tasks" in first
    assert second == "Without planning, 1 of 5 trials succeeded by themselves."


def test_exemplars_are_the_median_success_and_a_common_failure(folder):
    chosen = [(row["task"], row["seed"]) for row in Results.load(folder).exemplars()]
    # Of equally common failures, the one that comes first.
    assert chosen == [(BOX, 2), (BOX, 3), (CONE, 5), (CONE, 1)]


def test_faults_are_one_kind_of_ending(folder):
    box, _ = Results.load(folder).tasks
    assert box.count.endings == {"success": 3, "fault": 1}


def test_cells_of_a_task_without_success(make_row):
    count = Count(BOX, [make_row(BOX, 1), make_row(BOX, 2)])
    assert count.cells() == ("0/2", "0.00", "0.00 to 0.66", "-", "-")


def test_a_folder_of_something_else_is_named(tmp_path):
    with pytest.raises(UsageError, match=r"not the folder of a suite.*bench suite NAME"):
        Results.load(tmp_path)


def test_a_suite_without_a_finished_trial_is_named(folder):
    (folder / JOURNAL).write_text("")
    with pytest.raises(UsageError, match="no trial"):
        Results.load(folder)
