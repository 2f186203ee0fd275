"""What is told of a plan."""

import numpy as np
import pytest

from sumo_dist.costs.table import CostSettings
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanResult
from sumo_dist.planner.report import PlanReport

PLAN = Plan(3, 7, np.zeros((4, 9), np.float32), 1.5, "linear")
COST = CostSettings(np.array([10.0, -2.0]), np.array([1.5]))


def report(terms, valid=None, answered=None, failed=False, **account):
    terms = np.array(terms, float)
    rows = np.ones(len(terms), bool)
    valid, answered = (rows if flags is None else np.array(flags) for flags in (valid, answered))
    evaluation = Evaluation(terms, valid, answered, np.empty(0, np.float32))
    return PlanReport.of(PlanResult(PLAN, evaluation, COST, failed), 5.0, 2.0, **account)


def test_costs_and_terms_are_weighted_and_the_weights_are_told():
    told = report([[1.0, 2.0], [3.0, 4.0]])
    assert told.terms.tolist() == [10.0, -4.0]  # of the unperturbed candidate
    assert told.costs.tolist() == [6.0, 22.0]
    assert told.weights is COST.weights
    assert told.parameters is COST.parameters
    assert (told.plan, told.plan_ms, told.own_ms) == (PLAN, 5.0, 2.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_marked_and_travels_as_0(bad):
    told = report([[1.0, bad], [3.0, 4.0]], valid=[False, True])
    assert told.finite.tolist() == [False, True]
    assert told.costs.tolist() == [0.0, 22.0]
    assert told.terms.tolist() == [10.0, 0.0]


def test_lost_and_invalid_candidates_are_counted_apart():
    told = report(
        [[1.0, 1.0], [np.nan] * 2, [np.nan] * 2, [1.0, 1.0]],
        valid=[True, False, False, True],
        answered=[True, True, False, True],
        failed=True,
        workers=3,
        reissued=2,
        age_ticks=4,
    )
    assert (told.lost, told.invalid, told.failed) == (1, 1, True)
    assert (told.workers, told.reissued, told.age_ticks) == (3, 2, 4)
    assert told.finite.tolist() == [True, False, False, True]
