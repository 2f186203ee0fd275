import pytest

from sumo_dist.bench.results.cost import Cost, cost_cells


@pytest.fixture
def trial(make_row):
    """Return a function that makes a row: trial(time if solved, CPU of a plan [ms], of all [s])."""
    return lambda time, ms, seconds: make_row("a", 1, time, plan_cpu_ms=ms, plan_cpu_s=seconds)


def test_failures_cost_what_the_solved_ones_must_pay_for(trial):
    cost = Cost.of([trial(4.0, 10.0, 1.0), trial(4.0, 20.0, 2.0), trial(None, 90.0, 6.0)])
    assert cost is not None
    assert (cost.plan_ms, cost.solved_s) == (20.0, 4.5)
    assert 1.0 <= cost.low <= 4.5 <= cost.high


def test_many_alike_trials_leave_no_doubt(trial):
    cost = Cost.of([trial(4.0, 10.0, 2.0)] * 20)
    assert cost is not None
    assert (cost.solved_s, cost.low, cost.high) == (2.0, 2.0, 2.0)
    assert cost_cells(cost) == ("10.0", "2.00", "2.00 to 2.00")


def test_nobody_solved_and_nobody_measured_are_not_the_same(trial, make_row):
    assert cost_cells(Cost.of([trial(None, 10.0, 1.0)])) == ("10.0", "none solved", "-")
    unmeasured = [make_row("a", 1, 4.0), trial(None, None, None)]
    assert Cost.of(unmeasured) is None
    assert cost_cells(None) == ("-", "-", "-")
    both = Cost.of([*unmeasured, trial(4.0, 10.0, 3.0)])
    assert both is not None
    assert both.solved_s == 3.0
