import json

import pytest

from sumo_dist.bench.measure import scaling
from sumo_dist.bench.measure.pool_bench import Made
from sumo_dist.bench.measure.pool_model import Parts, RolloutTimes
from sumo_dist.bench.measure.pool_parts import DELAY_MS, parts
from sumo_dist.cli import main

EXACT = RolloutTimes([1, 8], [2.0, 16.0], [[1.0], [1.0]])  # 2 ms a row, always


def made(plan_ms, cpu_ms=0.0):
    return Made((plan_ms,) * 3, (plan_ms - 4.0,) * 3, (1.0,) * 3, cpu_ms, cpu_ms)


def test_parts_are_differences_of_plans():
    found = parts(
        EXACT,
        {
            (1, 1): made(DELAY_MS + 5.0, cpu_ms=1.0),
            (8, 8): made(DELAY_MS + 8.5, cpu_ms=4.0),
            (8, 64): made(DELAY_MS + 8.5 + 56 * 0.1),
            (16, 8): made(DELAY_MS + 8.5 + 8 * 0.25),
            (16, 16): made(DELAY_MS + 12.5, cpu_ms=8.0),
        },
    )
    assert (found.base_ms, found.inside_ms) == pytest.approx((5.0, 1.0))
    assert found.requests == [1, 8, 16]
    assert found.overhead_ms == pytest.approx([0.0, 3.0, 7.0])
    assert (found.row_ms, found.idle_ms) == pytest.approx((0.1, 0.25))


def test_limits_say_where_messages_alone_fill_the_period():
    found = Parts(EXACT, 5.0, 1.0, [1, 101], [0.0, 100.0], row_ms=0.0, idle_ms=0.0)
    limits = scaling.limits(found, {(1, 1): made(65.0, 1.0), (101, 101): made(165.0, 11.0)})
    assert limits["requests_that_fill_a_period"] == 47  # 5 + 46 ms
    assert limits["requests_that_fill_the_router"] == 500
    assert limits["router_cpu_ms_per_message"] == pytest.approx(0.05)
    assert limits["request_ms"] == pytest.approx(1.0)


def test_efficiency_is_speed_up_per_worker():
    found = Parts(EXACT, 5.0, 1.0, [1, 101], [0.0, 50.0], row_ms=0.0, idle_ms=0.0)
    row = scaling.predicted(32, 2, found)
    assert row["efficiency"] == pytest.approx((5 + 64) / (5 + 0.5 + 32) / 2, abs=1e-3)
    assert row["in_time"] == 32.0
    assert (row["fit"], row["fit_efficiency"]) == (43, pytest.approx(43 / 44, abs=1e-4))


@pytest.mark.slow
def test_predictions_come_with_plans_to_compare(capsys):
    command = ["bench", "scaling", "--json", "--workers", "1", "3", "--plans", "2"]
    assert main([*command, "--rollouts", "4", "--real", "1", "--slowdown", "1"]) == 0
    result = json.loads(capsys.readouterr().out)
    kinds = [(row["workers"], row["rollouts"]) for row in result["messages"]]
    assert kinds == [(1, 1), (3, 3), (3, 24)]
    assert all(row["plan_ms"] > 0 for row in result["messages"])
    assert [row["workers"] for row in result["predicted"]] == [1, 3]
    checked = [(row["what"].split(",")[0], row["rollouts"]) for row in result["checks"]]
    assert checked == [("1 real", 2), ("1 real", 4), ("6 scripted", 2), ("6 scripted", 4)]
    assert all(row["measured_ms"] > 0 and row["predicted_ms"] > 0 for row in result["checks"])
    assert 0 <= result["in_time_checks"][0]["measured"] <= result["in_time_checks"][0]["rollouts"]
    shown = "\n\n".join(scaling.text(result))
    assert "| rollouts that fit |" in shown
    assert "3 workers: p50 [ms]" in shown


@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        (["--workers", "0"], "workers must be at least 1, got 0"),
        (["--plans", "0"], "plans must be at least 1"),
        (["--slowdown", "0"], "slowdown must be in"),
        (["--slowdown", "nan"], "slowdown must be in"),
    ],
)
def test_bad_options_are_named(capsys, options, wrong):
    assert main(["bench", "scaling", *options]) == 2
    assert wrong in capsys.readouterr().err
