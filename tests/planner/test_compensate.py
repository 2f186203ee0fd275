import numpy as np
import pytest

from sumo_dist.planner.compensate import roll_forward
from sumo_dist.planner.plan import Plan


@pytest.fixture(scope="module")
def plan(problem):
    knots = np.random.default_rng(3).uniform(-0.5, 0.5, (4, problem.task.actions.size))
    return Plan(0, 10, knots.astype(np.float32), 0.5, "linear")


def forward(problem, engine, plan, tick, until, start):
    return roll_forward(engine, problem.task.actions, [plan], tick, until, *start)


def test_predicts_what_the_engine_rolls_out_under_the_plan(problem, engine, plan, start):
    state, memory = forward(problem, engine, plan, 12, 17, start)
    commands = problem.task.actions.commands(plan.at(np.arange(12, 17)))
    rollouts = engine.rollout(*start, commands[None])
    assert np.array_equal(state, rollouts.states[0, -1])
    assert np.array_equal(memory, rollouts.memory[0])


def test_plans_are_followed_in_turn_each_from_its_anchor(problem, engine, plan, start):
    actions = problem.task.actions
    later = Plan(1, 14, -plan.knots, 0.5, "linear")
    last = Plan(2, 30, plan.knots, 0.5, "linear")
    state, memory = roll_forward(engine, actions, [plan, later, last], 12, 17, *start)
    followed = [plan.at(np.arange(12, 14)), later.at(np.arange(14, 17))]
    rollouts = engine.rollout(*start, actions.commands(np.concatenate(followed))[None])
    assert np.array_equal(state, rollouts.states[0, -1])
    assert np.array_equal(memory, rollouts.memory[0])


def test_two_short_predictions_are_one_long_one(problem, engine, plan, start):
    """Memory goes along, but for the solver's warm start, which a new rollout begins without."""
    there = forward(problem, engine, plan, 12, 15, start)
    state, memory = forward(problem, engine, plan, 15, 18, there)
    straight, straight_memory = forward(problem, engine, plan, 12, 18, start)
    assert state == pytest.approx(straight, abs=1e-3)
    assert memory == pytest.approx(straight_memory, abs=1e-3)


@pytest.mark.parametrize("until", [12, 3])
def test_without_delay_the_state_stays(problem, engine, plan, start, until):
    state, memory = forward(problem, engine, plan, 12, until, start)
    assert state is start[0]
    assert memory is start[1]


def test_a_prediction_that_diverges_leaves_the_state_as_it_came(problem, plan, start):
    state, memory = start
    wild = state.copy()
    wild[problem.model.nq :] = 1e6  # [m/s], [rad/s]
    with problem.engine(threads=1) as engine:
        got, _ = forward(problem, engine, plan, 10, 30, (wild, memory))
    assert got is wild
