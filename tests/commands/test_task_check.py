"""`task check` on the command line: a line per check, and an exit code."""

import re

import pytest

from sumo_dist.check.checks import CHECKS
from sumo_dist.cli import main


def test_a_good_task_passes(capsys, monkeypatch):
    monkeypatch.setattr("sumo_dist.check.speed.COST_LIMIT", 10.0)  # the machine is shared
    assert main(["task", "check", "spot/upright_tire", "--seeds", "2"]) == 0
    out = capsys.readouterr().out
    assert out.count("\nok ") == len(CHECKS)
    assert "FAIL" not in out


def test_a_task_that_plans_slowly_is_told(capsys, monkeypatch):
    monkeypatch.setattr("sumo_dist.check.speed.COST_LIMIT", 0.1)
    assert main(["task", "check", "spot/move_box", "--seeds", "2"]) == 1
    assert re.search(
        r"FAIL +speed +a planning iteration takes .*more than 0.1", capsys.readouterr().out
    )


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["task", "check", "spot/move_bx"], "unknown task 'spot/move_bx'; valid: .*spot/move_box"),
        (["task", "check", "nothing.py"], "nothing.py does not exist on this host"),
        (["task", "check", "spot/move_box", "--seeds", "1"], "seeds must be from 2 to 1000, got 1"),
        (["task", "chek"], "unknown command 'task chek'; valid: .*task check"),
    ],
)
def test_bad_usage_says_what_is_valid(arguments, reason, capsys):
    assert main(arguments) == 2
    assert re.search(reason, capsys.readouterr().err)
