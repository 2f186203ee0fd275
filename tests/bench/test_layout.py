import json

import pytest

from sumo_dist.bench import layout
from sumo_dist.bench.results.stats import wilson
from sumo_dist.errors import UsageError


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Exact values of the score interval, from its definition by root finding.
    [
        (17, 20, 0.6396, 0.9476),
        (20, 20, 0.8389, 1.0),
        (0, 10, 0.0, 0.2775),
        (5, 10, 0.2366, 0.7634),
    ],
)
def test_wilson(successes, trials, low, high):
    assert wilson(successes, trials) == pytest.approx((low, high), abs=1e-4)


def test_markdown_aligns_its_columns():
    assert layout.markdown(("a", "long head"), [("wide cell", "b")]) == (
        "| a         | long head |\n| --------- | --------- |\n| wide cell | b         |"
    )


def test_the_fallback_is_benched_only_by_name(monkeypatch):
    monkeypatch.setattr(layout, "engine_identity", lambda _kind: ("fallback", "build"))
    assert layout.checked_engine("fallback") == ("fallback", "build")
    with pytest.raises(UsageError, match="--engine fallback"):
        layout.checked_engine("auto")


def test_a_table_has_a_column_for_each_format():
    rows = [{"a": 1.25, "b": [2, 3]}, {"a": 10.0, "b": [4, 5]}]
    assert layout.table({"a [ms]": "{a:.1f}", "b": "{b[0]} to {b[1]}"}, rows) == (
        "| a [ms] | b      |\n| ------ | ------ |\n| 1.2    | 2 to 3 |\n| 10.0   | 4 to 5 |"
    )


@pytest.mark.parametrize("as_json", [True, False])
def test_a_result_is_told_with_its_machine(as_json, capsys):
    result = layout.run_bench("bench x", as_json, lambda: {"n": 3}, lambda r: [f"n is {r['n']}"])
    told = capsys.readouterr().out
    assert result["n"] == 3 and result["machine"]
    if as_json:
        assert json.loads(told) == result
    else:
        assert told.startswith("# sumo-dist bench x\n") and told.endswith("\n\nn is 3\n")


def test_an_option_that_is_too_small_is_named():
    layout.check_at_least(1, trials=1, jobs=None)
    with pytest.raises(UsageError, match="jobs must be at least 1, got 0"):
        layout.check_at_least(1, trials=1, jobs=0)
