from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from sumo_dist.episode.referee import Referee
from sumo_dist.errors import UsageError
from sumo_dist.learn.environment import COST_UNIT
from sumo_dist.model.variation import Spread
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.observation import Observer
from sumo_dist.timing import PLAN_RATE, TICK, anchor_tick


def standing(environment):
    """The action (n,) of a robot that stands and waits, normalised."""
    return environment.actions.unit(environment.actions.default)


def pushes(environment, steps, seed=0):
    """Actions (steps, B, n) near standing, the base's the wildest."""
    rng = np.random.default_rng(seed)
    stand = standing(environment)
    return stand + rng.normal(0.0, 0.1, (steps, environment.config.count, len(stand)))


def follow(environment, actions):
    return [environment.step(each) for each in actions]


def test_actions_are_held_as_a_plan_is_followed(begin, problem):
    environment = begin(count=3)
    parameters = problem.task.table.named(problem.task.table.defaults.parameters)
    before = environment.state()["rows"]["states"].copy()
    action = pushes(environment, 1)[0]
    outcomes = [environment.step(action) for _ in range(2)]  # of 2 and 3 ticks at 20 Hz
    planner = PlannerConfig(horizon=0.1, nodes=1, spline="zero", rollouts=3)
    with problem.engine(1) as engine:
        evaluator = Evaluator(problem, engine, planner)
        memory = problem.policy.initial_memory()
        for row, state in enumerate(before):
            knots = action[row][None, None].astype(float)
            rollouts, _ = evaluator.roll_out(state, memory, knots)
            seen = Observer(problem.task, problem.model)(rollouts.states[:, -1], parameters)
            np.testing.assert_array_equal(outcomes[-1].observations[row], seen[0])


def test_equal_seeds_and_actions_give_equal_bits_on_any_number_of_threads(begin):
    spread = Spread(mass=0.5, friction=0.3, size=0.2)
    one, two = (begin(threads=n, models=3, spread=spread, time_limit=0.3) for n in (1, 2))
    actions = pushes(one, 12)
    for ours, theirs in zip(follow(one, actions), follow(two, actions), strict=True):
        for name, value in vars(ours).items():
            np.testing.assert_array_equal(value, getattr(theirs, name), err_msg=name)


def test_an_environment_goes_on_from_its_state(begin):
    spread = Spread(mass=0.5)
    whole = begin(models=2, spread=spread, time_limit=0.2)
    actions = pushes(whole, 8)
    expected = follow(whole, actions)
    first, then = (begin(models=2, spread=spread, time_limit=0.2) for _ in range(2))
    follow(first, actions[:3])
    then.restore(first.state())
    for ours, theirs in zip(follow(then, actions[3:]), expected[3:], strict=True):
        np.testing.assert_array_equal(ours.observations, theirs.observations)
        np.testing.assert_array_equal(ours.rewards, theirs.rewards)


def test_rewards_add_up_to_the_cost_that_was_taken_away(begin):
    environment = begin()
    outcomes = follow(environment, pushes(environment, 10))
    assert not any(outcome.ended.any() for outcome in outcomes)
    taken = (outcomes[0].cost - outcomes[-1].cost) / COST_UNIT
    np.testing.assert_allclose(sum(outcome.rewards for outcome in outcomes), taken, atol=1e-9)
    assert np.abs(taken).max() > 0.01
    np.testing.assert_array_equal(outcomes[0].rewards, 0.0)  # no cost is known of a start


def test_running_terms_are_paid_for_as_long_as_they_last(begin):
    """What is paid is the mean over an action's ticks, 2 or 3 of them, times how long it lasts."""
    plain, running, other = (
        begin(weight=("goal=0", "gripper=7", "velocity=0"), running=terms)
        for terms in ((), ("gripper",), ("goal",))
    )
    actions = pushes(plain, 6)
    distance = np.array([outcome.cost / 7 for outcome in follow(plain, actions)])  # (6, B)
    paid = np.array([outcome.rewards for outcome in follow(running, actions)]) * -COST_UNIT
    last = 7 * distance / PLAN_RATE
    assert np.abs(paid[1:] / last[1:] - 1).max() < 0.3  # of 2 or 3 ticks of 2.5 on average
    assert 0.9 < paid[1:].sum() / last[1:].sum() < 1.1
    assert {outcome.cost.any() for outcome in follow(running, actions)} == {False}
    # A running term that weighs nothing leaves the others as they were.
    rewards = [outcome.rewards for outcome in follow(other, actions)]
    np.testing.assert_allclose(np.diff(-7 * distance, axis=0) / COST_UNIT, rewards[1:], atol=1e-9)


@pytest.mark.parametrize("term", ["gait", "fall"])
def test_a_term_that_cannot_be_paid_for_is_refused(begin, term):
    with pytest.raises(UsageError, match=f"running term '{term}'; valid: goal, gripper, velocity"):
        begin(running=(term,))


def test_time_that_is_up_begins_anew_and_is_no_end_in_itself(begin):
    environment = begin(time_limit=0.2)
    outcomes = follow(environment, pushes(environment, 5))
    ends = [bool(outcome.timed_out.all()) for outcome in outcomes]
    assert ends == [False, False, False, True, False]  # 0.2 s are four actions
    np.testing.assert_array_equal(outcomes[3].ended, outcomes[3].timed_out)
    np.testing.assert_array_equal(outcomes[4].rewards, 0.0)


def test_staggered_episodes_end_at_different_times(begin):
    environment = begin(count=40, time_limit=1.0)
    environment.stagger()
    outcomes = follow(environment, pushes(environment, 20))
    ends = [int(outcome.timed_out.sum()) for outcome in outcomes]
    assert sum(ends) == 40  # each of them once
    assert max(ends) < 10


EASY = "success_radius=1.0", "success_speed=1.0", "goal=0,0"


def stand_at_the_goal(environment):
    """Put the boxes within the radius; return the action by which the robots stand."""
    environment.state()["rows"]["states"][:, 26:28] = 0.8, 0.0
    return np.tile(standing(environment), (environment.config.count, 1))


def test_success_ends_an_episode_and_takes_the_rest_of_the_cost_away(begin):
    environment = begin(param=EASY)
    outcome = environment.step(stand_at_the_goal(environment))
    assert outcome.solved.all()
    assert outcome.ended.all()
    assert not outcome.timed_out.any()


@pytest.mark.parametrize("ticks", [1, 2, 3, 5])
def test_success_must_hold_for_as_long_as_the_referee_asks(begin, problem, ticks):
    task = replace(problem.task, success_hold=ticks * TICK)
    environment = begin(param=EASY, problem=replace(problem, task=task))
    stand = stand_at_the_goal(environment)
    referee = Referee(task, problem.model)
    referee.parameters = task.table.adjusted((), EASY).parameters
    state = environment.state()["rows"]["states"][0].copy()
    expected = next(tick for tick in count(1) if referee.verdict(tick, state))
    solved = next(n for n in count(1) if environment.step(stand).solved.all())
    first, last = (anchor_tick(n, PLAN_RATE) for n in (solved - 1, solved))
    assert first < expected <= last


def test_a_fall_costs_what_the_term_weighs_and_ends_the_episode(begin):
    environment = begin(weight=["fall=250"])
    rows = environment.state()["rows"]["states"]
    rows[0, 2], rows[0, 3:7] = 0.2, (np.cos(0.7), np.sin(0.7), 0.0, 0.0)  # on its side
    outcome = environment.step(np.tile(standing(environment), (environment.config.count, 1)))
    assert list(outcome.fell) == [True] + [False] * 5
    assert outcome.rewards[0] == -250.0 / COST_UNIT


def test_a_rollout_that_diverges_counts_as_a_fall(begin):
    environment = begin()
    environment.state()["rows"]["states"][2, 33:] = 1e6  # velocities
    outcome = environment.step(np.tile(standing(environment), (environment.config.count, 1)))
    assert outcome.fell[2]
    assert np.isfinite(outcome.rewards).all()
    assert np.isfinite(outcome.observations).all()


def test_actions_beyond_the_limits_are_the_limits(begin):
    one, two = begin(), begin()
    far = np.full((one.config.count, len(standing(one))), 7.0)
    ours, theirs = one.step(far), two.step(np.ones_like(far))
    np.testing.assert_array_equal(ours.observations, theirs.observations)


@pytest.mark.parametrize("rate", [50, 7])
def test_a_second_of_robot_time_has_as_many_actions_as_the_rate(begin, rate):
    environment = begin(count=1, rate=rate)
    for _ in range(rate):
        environment.step(standing(environment)[None])
    assert environment.state()["rows"]["age"][0] == 50
