import json

import pytest

from sumo_dist.bench.measure import realtime
from sumo_dist.cli import main


def rows(*medians, cpu=240.0):
    return [
        {"rollouts": 32, "threads": 2**i, "wall_ms_median": median, "cpu_ms_median": cpu}
        for i, median in enumerate(medians)
    ]


@pytest.mark.parametrize(
    ("found", "cores", "words"),
    [
        (rows(120.0, 70.0, 45.0, 24.0), 4, "4"),
        (rows(50.0), 1, "1"),
        (rows(240.0, 130.0), 5, "at least 5"),
        (rows(900.0, 600.0, cpu=80.0), 2, "at least 2"),  # on a busy machine
    ],
)
def test_cores_are_the_fewest_in_time_or_a_lower_bound(found, cores, words):
    need = realtime.need(32, found)
    assert (need["cores"], need["text"]) == (cores, words)


def test_threads_are_doubled_up_to_all_cores():
    assert [realtime.powers(n) for n in (1, 2, 6, 16)] == [
        *((1,), (1, 2), (1, 2, 4, 6), (1, 2, 4, 8, 16)),
    ]


def test_whole_plans_are_timed(capsys):
    command = ["bench", "realtime", "--rollouts", "2", "4", "--threads", "1", "--repeats", "1"]
    assert main([*command, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [(row["rollouts"], row["threads"]) for row in result["rows"]] == [(2, 1), (4, 1)]
    assert all(0 < row["wall_ms_min"] <= row["wall_ms_median"] for row in result["rows"])
    assert [need["rollouts"] for need in result["needs"]] == [2, 4]
    shown = "\n\n".join(realtime.text(result))
    assert "| cores that 20 Hz needs |" in shown
    assert main([*command[:2], "--rollouts", "0"]) == 2
    assert "rollouts must be at least 1, got 0" in capsys.readouterr().err
