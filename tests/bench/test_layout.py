import pytest

from sumo_dist.bench import engine, layout
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
    monkeypatch.setattr(engine, "engine_identity", lambda _kind: ("fallback", "build"))
    assert engine.checked_engine("fallback") == ("fallback", "build")
    with pytest.raises(UsageError, match="--engine fallback"):
        engine.checked_engine("auto")
