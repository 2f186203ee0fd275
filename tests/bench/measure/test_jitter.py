import json

import pytest

from sumo_dist.bench.measure import jitter
from sumo_dist.cli import main
from sumo_dist.errors import SumoError


@pytest.mark.parametrize("flag", ["--trials=0", "--workers=0", "--seconds=0"])
def test_what_cannot_be_measured_is_refused(flag, capsys):
    assert main(["bench", "jitter", flag]) == 2
    assert "must be " in capsys.readouterr().err


def test_medians_and_ranges_are_over_runs():
    runs = [
        {
            "command_late_ms_p50": p50,
            "command_late_ms_p99": p99,
            "plans": 10,
            "missed_deadlines": 1,
            "rollouts_lost": 2,
        }
        for p50, p99 in ((1.0, 2.0), (1.2, 9.0), (1.4, 3.0))
    ]
    assert jitter.row("normal", runs) == {
        "priority": "normal",
        "late_ms_p50": 1.2,
        "late_ms_p99": 3.0,
        "late_ms_p99_range": [2.0, 9.0],
        "plans": 30,
        "missed": 3,
        "rollouts_lost": 6,
    }


@pytest.mark.slow
def test_a_run_that_fails_is_said():
    with pytest.raises(SumoError, match=r"the run with seed 1 failed: .*unknown task"):
        jitter.run(jitter.Options(task="spot/nothing", workers=1), 1, "normal")


@pytest.mark.slow
@pytest.mark.alone
def test_times_real_runs(monkeypatch, capsys):
    monkeypatch.setattr(jitter, "CHOICES", ("normal",))  # what any machine permits
    options = ["--trials", "1", "--seconds", "1", "--workers", "1", "--json"]
    assert main(["bench", "jitter", *options]) == 0
    result = json.loads(capsys.readouterr().out)
    (row,) = result["rows"]
    assert 0 < row["late_ms_p50"] <= row["late_ms_p99"]
    assert row["plans"] > 0
