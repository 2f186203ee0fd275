import json

import pytest

from sumo_dist.bench.results.journal import STANDING, Journal, Trial, read_rows
from sumo_dist.errors import UsageError

SETTINGS = {"planner": {"rollouts": 32, "elites": 3}, "engine_build": "b1"}
OF_TASK = {"spot/move_box": {"config_hash": "c1"}}
TRIAL = Trial("spot/move_box", 1)
ROW = {**TRIAL._asdict(), "success": True, "config_hash": "c1", **SETTINGS}


def open_journal(path, notices=None):
    def settings(trial):
        return {**SETTINGS, **OF_TASK.get(trial.task, {})}

    return Journal(path, settings, ([] if notices is None else notices).append)


def test_what_was_appended_is_there_again(tmp_path):
    open_journal(tmp_path / "a.jsonl").append(ROW)
    assert open_journal(tmp_path / "a.jsonl").rows == {TRIAL: ROW}
    assert read_rows(tmp_path / "a.jsonl") == [ROW]


def test_a_torn_last_line_is_dropped_with_a_notice(tmp_path):
    path, notices = tmp_path / "a.jsonl", []
    path.write_text(json.dumps(ROW) + "\n" + json.dumps({**ROW, "seed": 2})[:-1])
    journal = open_journal(path, notices)
    assert list(journal.rows) == [TRIAL]
    assert len(notices) == 1
    journal.append({**ROW, "seed": 2})
    del journal
    assert list(open_journal(path).rows) == [TRIAL, TRIAL._replace(seed=2)]


def test_two_campaigns_do_not_write_to_one_file(tmp_path):
    first = open_journal(tmp_path / "a.jsonl")
    with pytest.raises(UsageError, match=r"another campaign writes to .*a.jsonl"):
        open_journal(tmp_path / "a.jsonl")
    first.append(ROW)
    assert read_rows(tmp_path / "a.jsonl") == [ROW]


def test_a_reader_leaves_the_line_that_is_being_written_alone(tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_text(content := json.dumps(ROW) + "\n" + json.dumps({**ROW, "seed": 2})[:40])
    assert read_rows(path) == [ROW]
    assert path.read_text() == content


def test_a_control_stands_beside_the_trial_it_belongs_to(tmp_path):
    journal, control = open_journal(tmp_path / "a.jsonl"), {**ROW, "variant": STANDING}
    journal.append(ROW)
    journal.append(control)
    del journal
    rows = open_journal(tmp_path / "a.jsonl").rows
    assert rows == {TRIAL: ROW, TRIAL._replace(variant=STANDING): control}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"planner": {"rollouts": 16, "elites": 3}}, "rollouts is 16 there and 32 here"),
        ({"engine_build": "b2"}, "engine_build is b2 there and b1 here"),
        ({"config_hash": "c2"}, "config_hash is c2 there and c1 here"),
    ],
)
def test_a_file_of_other_settings_is_refused(tmp_path, change, said):
    (tmp_path / "a.jsonl").write_text(json.dumps({**ROW, **change}) + "\n")
    with pytest.raises(UsageError, match=said):
        open_journal(tmp_path / "a.jsonl")


def test_a_file_that_does_not_say_has_the_usual_settings(tmp_path):
    (tmp_path / "a.jsonl").write_text(json.dumps(ROW) + "\n")
    usual = {"plant": "nominal", "estimator": "truth", "weight": [], "param": []}
    Journal(tmp_path / "a.jsonl", lambda _trial: usual, [].append)
    with pytest.raises(UsageError, match=r"weight is \[\] there and \['goal=80'\] here"):
        Journal(tmp_path / "a.jsonl", lambda _trial: usual | {"weight": ["goal=80"]}, [].append)


def test_another_tasks_rows_may_stand_beside(tmp_path):
    row = {**ROW, "task": "spot/move_cone", "config_hash": "c9"}
    (tmp_path / "a.jsonl").write_text(json.dumps(row) + "\n")
    assert list(open_journal(tmp_path / "a.jsonl").rows) == [Trial("spot/move_cone", 1)]


@pytest.mark.parametrize(
    "content", [b"hello\n", b"hello", b"[1]\n", b'{"task": 1}\n', b"\xff\xfe\n"]
)
def test_a_file_of_something_else_is_refused_and_left_alone(tmp_path, content):
    path = tmp_path / "a.jsonl"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=r"a\.jsonl"):
        open_journal(path)
    assert path.read_bytes() == content


def test_a_place_that_cannot_be_written_is_one_error(tmp_path):
    with pytest.raises(UsageError, match="cannot use"):
        open_journal(tmp_path / "missing" / "a.jsonl")
