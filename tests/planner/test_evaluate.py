from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.costs.terms import CostTerm
from sumo_dist.errors import TaskError, UsageError
from sumo_dist.planner.evaluate import TRACE_POINTS, Evaluation, Evaluator
from sumo_dist.planner.plan import Plan


@pytest.fixture(scope="module")
def knots(problem, config):
    shape = config.rollouts, config.nodes, problem.task.actions.size
    return np.random.default_rng(0).uniform(-1, 1, shape).astype(np.float32)


@pytest.fixture(scope="module")
def table(problem):
    return problem.task.table


@pytest.fixture(scope="module")
def usual(table):
    """Parameters as the task has them."""
    return table.defaults.parameters


@pytest.fixture(scope="module")
def whole(evaluator, start, usual, knots):
    return evaluator(*start, usual, knots)


def evaluation(terms, valid=None):
    terms = np.array(terms, float)
    rows = len(terms)
    valid = np.ones(rows, bool) if valid is None else np.array(valid)
    return Evaluation(terms, valid, np.ones(rows, bool), np.empty(0, np.float32))


def test_a_candidates_cost_is_the_weighted_sum_of_its_terms():
    candidates = evaluation([[1.0, 2.0, -0.5], [0.0, 0.0, 4.0]])
    assert candidates.costs(np.ones(3)).tolist() == [2.5, 4.0]
    assert candidates.costs(np.array([2.0, -1.0, 0.5])).tolist() == [-0.25, 2.0]


def test_what_is_not_finite_or_not_valid_is_worst():
    terms = [[1.0, np.nan], [np.inf, -np.inf], [-np.inf, 0.0], [1.0, 1.0], [1.0, 1.0]]
    costs = evaluation(terms, valid=[True, True, True, False, True]).costs(np.ones(2))
    assert costs.tolist() == [np.inf, np.inf, np.inf, np.inf, 2.0]


def test_a_weight_of_0_makes_nothing_of_what_is_not_finite():
    assert evaluation([[1.0, np.nan], [2.0, np.inf]]).costs(np.array([1.0, 0.0])).tolist() == [
        np.inf,
        np.inf,
    ]


def test_every_row_has_its_terms_and_its_trace(whole, problem, config, table):
    rows = config.rollouts
    assert whole.terms.shape == (rows, len(problem.task.cost))
    assert whole.valid.all()
    assert whole.answered.all()
    assert np.isfinite(whole.costs(table.defaults.weights)).all()
    assert whole.traces.shape == (rows, len(problem.task.trails), TRACE_POINTS, 3)
    assert whole.traces.dtype == np.float32


@pytest.mark.parametrize("cuts", [[1], [6], [3, 5, 11], list(range(1, 12))])
def test_the_same_bits_however_the_batch_is_split(evaluator, start, usual, knots, whole, cuts):
    parts = [evaluator(*start, usual, part) for part in np.split(knots, cuts)]
    for name in ("terms", "valid", "traces"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(joined, getattr(whole, name)), name


def test_the_same_bits_in_another_order_and_among_other_rows(evaluator, start, usual, knots, whole):
    order = np.random.default_rng(1).permutation(len(knots))
    shuffled = evaluator(*start, usual, np.concatenate([knots[order], knots[:3] * 0.5]))
    assert np.array_equal(shuffled.terms[: len(knots)], whole.terms[order])


def test_the_same_bits_with_more_threads(problem, config, start, usual, knots, whole):
    with problem.engine(threads=3) as engine:
        again = Evaluator(problem, engine, config)(*start, usual, knots)
    assert np.array_equal(again.terms, whole.terms)


def test_the_traces_end_where_the_rollout_ends(
    problem, config, engine, evaluator, start, usual, knots
):
    """The last trace point is the frame's position after the last policy step."""
    state, memory = start
    actions = problem.task.actions
    plan = Plan(0, 0, knots[0], config.horizon, config.spline)
    unit = plan.at(np.arange(config.steps))
    rollouts = engine.rollout(state, memory, actions.commands(unit)[None])
    trails = [problem.layout.names.index(name) for name in problem.task.trails]
    traces = evaluator(state, memory, usual, knots[:1]).traces
    assert traces[0, :, -1] == pytest.approx(rollouts.positions[0, -1, trails], abs=1e-4)


@pytest.mark.parametrize("shape", [(2, 4, 9), (2, 6, 9), (2, 5, 8), (5, 9)])
def test_knots_of_another_shape_are_refused(evaluator, start, usual, shape):
    with pytest.raises(UsageError, match=r"knots have shape .*; they need \(rollouts, 5, 9\)"):
        evaluator(*start, usual, np.zeros(shape, np.float32))


def test_a_weight_scales_its_own_term_and_nothing_else(whole, table):
    """Weights are applied to what the workers returned: nobody rolls out again for them."""
    before = whole.costs(table.defaults.weights)
    heavier = table.with_weight(table.defaults, "goal", 80.0)
    goal = whole.terms[:, table.terms.index("goal")]
    assert whole.costs(heavier.weights) - before == pytest.approx(20.0 * goal)
    assert (goal > 0.5).all()
    only = np.zeros(len(table.terms))
    only[table.terms.index("gripper")] = 4.0
    assert np.array_equal(whole.costs(only), 4.0 * whole.terms[:, table.terms.index("gripper")])


def test_a_goal_that_moved_changes_the_distance_to_it_and_nothing_else(
    problem, engine, config, evaluator, start, knots, whole, table
):
    moved = table.with_parameter(table.defaults, "goal", (1.5, -0.5))
    there = evaluator(*start, moved.parameters, knots)
    rollouts, _ = evaluator.roll_out(*start, knots)
    box = rollouts.positions[:, :, problem.layout.names.index("object")]
    way = np.linalg.norm(box - [1.5, -0.5, 0.254], axis=-1).mean(axis=1)
    goal = table.terms.index("goal")
    assert there.terms[:, goal] == pytest.approx(way, rel=1e-12)
    others = [i for i in range(len(table.terms)) if i != goal]
    assert np.array_equal(there.terms[:, others], whole.terms[:, others])
    assert np.array_equal(there.traces, whole.traces)
    assert not np.isclose(there.terms[:, goal], whole.terms[:, goal]).any()


def test_rollouts_are_costed_again_without_rolling_out(evaluator, start, knots, whole, table):
    rollouts, physical = evaluator.roll_out(*start, knots)
    again = evaluator.terms(rollouts, physical, table.defaults.parameters)
    assert np.array_equal(again, whole.terms)


def test_a_joint_is_costed_by_its_name(problem, engine, config, start, usual, knots):
    """The servo's target is what the policy said, the position what came of it."""
    knee = CostTerm("knee", lambda r: r.joints["fl_kn"].pos, 1.0)
    lag = CostTerm("lag", lambda r: r.joints["fl_kn"].target - r.joints["fl_kn"].pos, 1.0)
    task = replace(problem.task, cost=(knee, lag))
    evaluator = Evaluator(replace(problem, task=task), engine, config)
    terms = evaluator(*start, usual, knots).terms
    rollouts, _ = evaluator.roll_out(*start, knots)
    robot = task.scene.robot
    column = 7 + robot.joints.index("fl_kn")
    angle = rollouts.states[:, :, column]
    target = rollouts.targets[:, :, robot.joints.index("fl_kn")]
    assert terms[:, 0] == pytest.approx(angle.mean(axis=1), rel=1e-12)
    assert terms[:, 1] == pytest.approx((target - angle).mean(axis=1), rel=1e-9)
    assert np.ptp(angle) > 0.01


def test_a_term_that_is_not_finite_is_blamed_and_a_rollout_that_diverges_is_not(
    problem, config, start, usual, knots
):
    def log(r):
        return np.log(r.base.pos[..., 2] - 9.0)

    cost = (*problem.task.cost[:1], CostTerm("depth", log, 1.0), *problem.task.cost[1:])
    faulty = replace(problem, task=replace(problem.task, cost=cost))
    state, memory = start
    thrown = state.copy()
    thrown[problem.model.nq :] = 1e7
    with problem.engine(1) as engine:
        evaluator = Evaluator(faulty, engine, config)
        with pytest.raises(TaskError, match=r"'depth': test_evaluate.py, line \d+: not f"):
            evaluator.blame(state, memory, usual, knots[:1])
        evaluator.blame(thrown, memory, usual, knots[:1])
        Evaluator(problem, engine, config).blame(state, memory, usual, knots[:1])
