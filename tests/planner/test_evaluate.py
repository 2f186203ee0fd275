import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.planner.evaluate import TRACE_POINTS, Evaluation, Evaluator
from sumo_dist.timing import TICK


@pytest.fixture(scope="module")
def knots(problem, config):
    shape = config.rollouts, config.nodes, problem.task.actions.size
    return np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)


@pytest.fixture(scope="module")
def whole(evaluator, start, knots):
    return evaluator(*start, knots)


def evaluation(terms, valid=None):
    terms = np.array(terms, float)
    rows = len(terms)
    valid = np.ones(rows, bool) if valid is None else np.array(valid)
    return Evaluation(terms, valid, np.ones(rows, bool), np.empty(0, np.float32))


def test_a_candidates_cost_is_the_sum_of_its_terms():
    assert evaluation([[1.0, 2.0, -0.5], [0.0, 0.0, 4.0]]).costs.tolist() == [2.5, 4.0]


def test_what_is_not_finite_or_not_valid_is_worst():
    terms = [[1.0, np.nan], [np.inf, -np.inf], [-np.inf, 0.0], [1.0, 1.0], [1.0, 1.0]]
    costs = evaluation(terms, valid=[True, True, True, False, True]).costs
    assert costs.tolist() == [np.inf, np.inf, np.inf, np.inf, 2.0]


def test_every_row_has_its_terms_and_its_trace(whole, problem, config):
    rows = config.rollouts
    assert whole.terms.shape == (rows, len(problem.task.cost))
    assert whole.valid.all()
    assert whole.answered.all()
    assert np.isfinite(whole.costs).all()
    assert whole.traces.shape == (rows, len(problem.task.trails), TRACE_POINTS, 3)
    assert whole.traces.dtype == np.float32


@pytest.mark.parametrize("cuts", [[1], [6], [3, 5, 11], list(range(1, 12))])
def test_the_same_bits_however_the_batch_is_split(evaluator, start, knots, whole, cuts):
    parts = [evaluator(*start, part) for part in np.split(knots, cuts)]
    for name in ("terms", "valid", "traces"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(joined, getattr(whole, name)), name


def test_the_same_bits_in_another_order_and_among_other_rows(evaluator, start, knots, whole):
    order = np.random.default_rng(1).permutation(len(knots))
    shuffled = evaluator(*start, np.concatenate([knots[order], knots[:3] * 0.5]))
    assert np.array_equal(shuffled.terms[: len(knots)], whole.terms[order])


def test_the_same_bits_with_more_threads(problem, config, start, knots, whole):
    with problem.engine(threads=3) as engine:
        assert np.array_equal(Evaluator(problem, engine, config)(*start, knots).terms, whole.terms)


def test_the_traces_end_where_the_rollout_ends(problem, config, engine, evaluator, start, knots):
    """The last trace point is the frame's position after the last policy step."""
    state, memory = start
    actions = problem.task.actions
    steps = np.linspace(0.0, config.horizon, config.nodes)
    times = np.arange(config.steps) * TICK
    unit = np.stack([np.interp(times, steps, knots[0, :, i]) for i in range(actions.size)], axis=-1)
    rollouts = engine.rollout(state, memory, actions.commands(unit)[None])
    trails = [problem.layout.names.index(name) for name in problem.task.trails]
    traces = evaluator(state, memory, knots[:1]).traces
    assert traces[0, :, -1] == pytest.approx(rollouts.positions[0, -1, trails], abs=1e-4)


@pytest.mark.parametrize("shape", [(2, 3, 9), (2, 5, 9), (2, 4, 8), (4, 9)])
def test_knots_of_another_shape_are_refused(evaluator, start, shape):
    with pytest.raises(UsageError, match=r"knots have shape .*; they need \(rollouts, 4, 9\)"):
        evaluator(*start, np.zeros(shape, np.float32))
