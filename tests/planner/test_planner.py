from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.costs.table import CostSettings
from sumo_dist.optim import OPTIMIZERS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import Planner, PlanRequest
from sumo_dist.robots.spot import spot_actions
from sumo_dist.timing import TICK

ACTIONS = spot_actions()
N = ACTIONS.size
COST = CostSettings(np.ones(1), np.empty(0))


def request(number=0, tick=0, previous=None, cost=COST):
    return PlanRequest(number, tick, np.zeros(3), np.zeros(2, np.float32), previous, cost)


def previous_plan():
    knots = np.random.default_rng(0).uniform(-1, 1, (4, N)).astype(np.float32)
    return Plan(number=0, tick=0, knots=knots, horizon=1.5, spline="linear")


def evaluation(costs):
    costs = np.asarray(costs, float)
    valid = np.isfinite(costs)
    return Evaluation(costs[:, None], valid, np.ones(len(costs), bool), np.empty(0, np.float32))


class Bowl:
    """A cost with its minimum at 0.3 everywhere; keeps what it was asked for."""

    def __init__(self):
        self.asked = []

    def __call__(self, request, iteration, knots):
        self.asked.append(knots)
        return evaluation(((knots - 0.3) ** 2).sum(axis=(1, 2)))


def all_lost(request, iteration, knots):
    return evaluation(np.full(len(knots), np.inf))


LINEAR = PlannerConfig(spline="linear", nodes=4)


def test_the_first_plan_starts_from_standing_still():
    knots = Planner(PlannerConfig(), ACTIONS, seed=0).shifted(request())
    assert knots.shape == (5, N)
    assert np.allclose(ACTIONS.physical(knots), ACTIONS.default)


def test_the_mean_is_the_previous_plan_at_the_new_node_times():
    planner, previous = Planner(LINEAR, ACTIONS, seed=0), previous_plan()
    knots = planner.shifted(request(number=1, tick=5, previous=previous))
    times = np.array([0.1, 0.6, 1.1, 1.6])  # 5 ticks later; the last is beyond the horizon
    assert knots == pytest.approx(previous.at_times(times))
    assert knots[-1] == pytest.approx(previous.knots[-1])


def test_a_shift_keeps_what_the_spline_says():
    """Where old and new nodes coincide, the shifted plan is the old one, moved by a node."""
    previous = previous_plan()
    planner = Planner(LINEAR, ACTIONS, seed=0)
    knots = planner.shifted(request(number=10, tick=25, previous=previous))  # 0.5 s: one node
    assert knots[:-1] == pytest.approx(previous.knots[1:])


def test_candidates_are_the_shifted_plan_and_noise_around_it():
    bowl, planner = Bowl(), Planner(replace(LINEAR, rollouts=16), ACTIONS, seed=0)
    asked_for = request(number=1, tick=2, previous=previous_plan())
    planner.plan(asked_for, bowl)
    (knots,) = bowl.asked
    assert knots.shape == (16, 4, N)
    assert np.array_equal(knots[0], planner.shifted(asked_for).astype(np.float32))
    assert len({row.tobytes() for row in knots}) == 16


def test_seed_and_plan_number_decide_the_noise():
    def noise(seed, number):
        bowl = Bowl()
        Planner(PlannerConfig(iterations=2), ACTIONS, seed).plan(request(number), bowl)
        return [knots.tobytes() for knots in bowl.asked]

    assert noise(1, 2) == noise(1, 2)
    draws = [*noise(1, 2), *noise(1, 3), *noise(2, 2), *noise(2**62, 2)]
    assert len(set(draws)) == 8


def test_a_planner_keeps_nothing_between_plans():
    planner = Planner(PlannerConfig(iterations=2), ACTIONS, seed=0)
    first = planner.plan(request(3), Bowl()).plan.knots
    planner.plan(request(4, tick=10, previous=previous_plan()), Bowl())
    assert np.array_equal(planner.plan(request(3), Bowl()).plan.knots, first)


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_a_smooth_plan_goes_on_where_the_last_one_is(optimizer):
    """The limbs' targets, in value and slope, for every candidate and the plan."""
    config, bowl = PlannerConfig(optimizer, rollouts=16, iterations=2), Bowl()
    planner = Planner(config, ACTIONS, seed=0)
    first = planner.plan(request(0), Bowl()).plan
    result = planner.plan(request(1, tick=3, previous=first), bowl)
    before, now = first.at(np.array([2, 3]))
    for knots in (*np.concatenate(bowl.asked), result.plan.knots):
        assert knots[:2, 3:] == pytest.approx(np.array([before, now])[:, 3:], abs=1e-6)
    actions = np.concatenate([first.at(np.arange(4)), result.plan.at(np.arange(4, 9))])
    jumps = np.abs(np.diff(actions, axis=0)).max(axis=0)[3:]
    assert not np.array_equal(result.plan.knots[2:], planner.shifted(request(1, 3, first))[2:])
    assert jumps.max() < 0.2  # at 0.5 s the knots are up to 2 away


def test_the_velocities_of_the_base_start_anew():
    """On the line to their next knot."""
    bowl, config = Bowl(), PlannerConfig(rollouts=16)
    planner = Planner(config, ACTIONS, seed=0)
    planner.plan(request(1, tick=3, previous=planner.plan(request(), Bowl()).plan), bowl)
    candidates = bowl.asked[0][..., :3]
    assert (candidates[:, 1].std(axis=0) > 0.1).all()
    spacing = config.horizon / (config.nodes - 2)
    ahead = (candidates[:, 2] - candidates[:, 1]) / spacing
    behind = (candidates[:, 1] - candidates[:, 0]) / TICK
    inside = np.abs(candidates[:, 0]) < 1.0
    assert behind[inside] == pytest.approx(ahead[inside], abs=1e-4)


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_a_plan_is_better_than_the_mean_it_started_from(optimizer):
    config = PlannerConfig(optimizer, variance_first=0.001, variance_last=0.001)
    result = Planner(config, ACTIONS, seed=0).plan(request(), bowl := Bowl())
    (candidates,) = bowl.asked
    cost = ((result.plan.knots - 0.3) ** 2).sum()
    assert cost < ((candidates[0] - 0.3) ** 2).sum()
    assert not result.failed


def test_a_plan_is_anchored_on_its_request():
    plan = Planner(PlannerConfig(spline="cubic"), ACTIONS, seed=0).plan(request(4, 10), Bowl()).plan
    assert (plan.number, plan.tick, plan.horizon, plan.spline) == (4, 10, 1.5, "cubic")
    assert plan.knots.dtype == np.float32
    assert np.abs(plan.knots).max() <= 1.0


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_the_shifted_plan_goes_on_when_all_candidates_are_lost(optimizer):
    planner = Planner(PlannerConfig(optimizer), ACTIONS, seed=0)
    asked_for = request(number=1, tick=5, previous=previous_plan())
    result = planner.plan(asked_for, all_lost)
    assert result.failed
    assert np.array_equal(result.plan.knots, planner.shifted(asked_for).astype(np.float32))


def test_what_an_iteration_found_is_kept_when_the_next_one_is_lost():
    bowl = Bowl()

    def lost_later(request, iteration, knots):
        evaluation = bowl(request, iteration, knots)
        return evaluation if iteration == 0 else all_lost(request, iteration, knots)

    result = Planner(PlannerConfig(iterations=2), ACTIONS, seed=0).plan(request(), lost_later)
    _, second = bowl.asked
    assert not result.failed
    assert np.array_equal(result.plan.knots, second[0])  # the mean that the second one began with


def test_inner_iterations_of_cem_narrow_the_search():
    def spread(knots):
        return knots[1:].std(axis=0).mean()

    bowl = Bowl()
    config = PlannerConfig("cem", rollouts=32, iterations=3)
    Planner(config, ACTIONS, seed=0).plan(request(), bowl)
    first, second, third = map(spread, bowl.asked)
    assert third < second < first


def test_iterations_share_the_rollouts_of_a_plan():
    bowl = Bowl()
    config = PlannerConfig(rollouts=32, iterations=3, decay=1.25)
    Planner(config, ACTIONS, seed=0).plan(request(), bowl)
    assert [len(knots) for knots in bowl.asked] == [13, 10, 9]


def test_each_iteration_starts_from_what_the_one_before_it_found():
    bowl = Bowl()
    Planner(PlannerConfig("cem", iterations=2), ACTIONS, seed=0).plan(request(), bowl)
    first, second = bowl.asked
    elites = np.argsort(((first - 0.3) ** 2).sum(axis=(1, 2)))[:3]
    assert second[0] == pytest.approx(first[elites].mean(axis=0))


def test_the_best_candidate_of_all_iterations_can_be_executed():
    bowl = Bowl()
    config = PlannerConfig(iterations=3, execute="best")
    plan = Planner(config, ACTIONS, seed=0).plan(request(), bowl).plan
    candidates = np.concatenate(bowl.asked)
    best = candidates[np.argmin(((candidates - 0.3) ** 2).sum(axis=(1, 2)))]
    assert np.array_equal(plan.knots, best)


def test_coloured_noise_makes_neighbouring_nodes_move_together():
    def together(exponent):
        bowl = Bowl()
        config = replace(
            LINEAR, rollouts=4000, variance_first=0.01, variance_last=0.01, noise_exponent=exponent
        )
        Planner(config, ACTIONS, seed=0).plan(request(), bowl)
        noise = bowl.asked[0][1:, :, 0]  # of a dimension that starts in the middle of its range
        return np.corrcoef(noise[:, 1], noise[:, 2])[0, 1]

    assert together(0.0) == pytest.approx(0.0, abs=0.1)
    assert together(2.0) == pytest.approx(0.78, abs=0.1)


def test_the_base_is_searched_with_a_noise_of_its_own():
    """Velocities may jump, joint targets topple the robot: the ratio is of standard deviations."""
    spreads = {}
    for ratio in (1.0, 3.0):
        small = {"variance_first": 1e-4, "variance_last": 1e-4}  # nothing is clipped
        cost = Bowl()
        Planner(PlannerConfig(base_noise=ratio, **small), ACTIONS, seed=0).plan(request(), cost)
        spreads[ratio] = (cost.asked[0] - cost.asked[0][0]).std(axis=(0, 1))
    assert spreads[3.0][:3] == pytest.approx(3 * spreads[1.0][:3], rel=1e-3)
    assert np.array_equal(spreads[3.0][3:], spreads[1.0][3:])


def test_a_space_may_search_a_limb_with_less_noise():
    spreads = {}
    for space in (spot_actions(torso=True), spot_actions(torso=True, noise={"torso": 0.5})):
        small = {"variance_first": 1e-4, "variance_last": 1e-4}  # nothing is clipped
        cost = Bowl()
        middle = space.physical(np.zeros(space.size))
        Planner(PlannerConfig(**small), replace(space, default=middle), 0).plan(request(), cost)
        spreads[space.noise[-1]] = (cost.asked[0] - cost.asked[0][0]).std(axis=(0, 1))
    assert np.array_equal(spreads[0.5][:-2], spreads[1.0][:-2])
    assert spreads[0.5][-2:] == pytest.approx(0.5 * spreads[1.0][-2:], rel=1e-3)


@pytest.mark.parametrize("spline", ["linear", "smooth"])
def test_the_search_it_tells_of_is_the_noise_it_draws(spline):
    small = {"variance_first": 1e-5, "variance_last": 1e-4}  # nothing is clipped
    settings = PlannerConfig(spline=spline, rollouts=2000, **small)
    planner, bowl = Planner(settings, ACTIONS, seed=0), Bowl()
    planner.plan(request(), bowl)
    times, sigma = planner.search
    drawn = bowl.asked[0][:, -len(times) :].std(axis=0)
    assert times[0] == 0.0
    assert times[-1] == settings.horizon
    assert drawn == pytest.approx(sigma, rel=0.1, abs=1e-5)


def test_candidates_near_the_mean_are_so_in_every_iteration():
    cost = Bowl()
    small = {"variance_first": 1e-4, "variance_last": 1e-4}  # nothing is clipped
    config = PlannerConfig(rollouts=2002, iterations=2, placement="near", **small)
    Planner(config, ACTIONS, seed=0).plan(request(), cost)
    for asked in cost.asked:
        moves = np.abs(asked[1:] - asked[0]).mean(axis=(1, 2))
        assert moves[1::2].mean() / moves[::2].mean() == pytest.approx(1 / 3, rel=0.1)


@pytest.mark.parametrize("iterations", [1, 2])
def test_a_plan_of_fewer_rollouts_has_as_many_candidates(iterations):
    bowl = Bowl()
    planner = Planner(PlannerConfig(iterations=iterations), ACTIONS, seed=0)
    planner.plan(request(), bowl, rollouts=9)
    assert sum(map(len, bowl.asked)) == 9


def test_the_weights_of_the_question_decide_which_candidate_is_best():
    """Of two terms, one for each end of the same sum."""

    def ends(request, iteration, knots):
        total = knots.sum(axis=(1, 2), dtype=float)
        good = np.ones(len(knots), bool)
        terms = np.stack([total, -total], axis=1)
        return Evaluation(terms, good, good, np.empty(0, np.float32))

    def chosen(*weights):
        cost = CostSettings(np.array(weights), np.empty(0))
        config = PlannerConfig(execute="best", rollouts=16)
        result = Planner(config, ACTIONS, seed=0).plan(request(cost=cost), ends)
        assert result.cost is cost
        totals = result.evaluation.terms[:, 0]
        return result.plan.knots.sum(dtype=float), totals.min(), totals.max()

    for weights in ((1.0, 0.0), (0.0, -1.0), (2.0, 1.0)):
        total, least, _ = chosen(*weights)
        assert total == least
    for weights in ((-1.0, 0.0), (0.0, 1.0), (1.0, 2.0)):
        total, _, most = chosen(*weights)
        assert total == most


def test_parameters_travel_with_the_question():
    seen = []

    def look(request, iteration, knots):
        seen.append(request.cost.parameters.tolist())
        return evaluation(np.zeros(len(knots)))

    cost = CostSettings(np.ones(1), np.array([3.0, 4.0]))
    Planner(PlannerConfig(iterations=2), ACTIONS, seed=0).plan(request(cost=cost), look)
    assert seen == [[3.0, 4.0]] * 2


WALK = np.tile([0.25, -0.5, 1.0], (4, 1))  # (F, 3) of the base


def walks(state, parameters, mean):
    """Propose that the base walks, and all else goes on as planned."""
    knots = mean.copy()
    knots[:, :3] = WALK
    return knots


def asked_with(guide, config):
    """Candidates of every iteration of a plan that follows another one."""
    bowl = Bowl()
    previous = Planner(PlannerConfig(), ACTIONS, seed=0).plan(request(), Bowl()).plan
    Planner(config, ACTIONS, 0, guide).plan(request(1, tick=3, previous=previous), bowl)
    return bowl.asked


@pytest.mark.parametrize("config", [PlannerConfig(iterations=2), replace(LINEAR, rollouts=2)])
def test_what_a_guide_proposes_is_the_last_candidate_of_a_plan(config):
    """Its base walks as proposed, its limbs move as in the last plan; all others are as ever."""
    drawn, guided = asked_with(None, config), asked_with(walks, config)
    assert np.array_equal(guided[0][:-1], drawn[0][:-1])
    assert guided[0][-1][-4:, :3] == pytest.approx(WALK)
    assert np.array_equal(guided[0][-1][:, 3:], guided[0][0][:, 3:])
    if config.iterations > 1:  # what came of it the next one begins with
        assert not any(np.array_equal(row[-4:, :3], WALK) for row in guided[1][1:])


def test_a_guide_is_asked_for_the_state_and_the_parameters_of_the_plan():
    asked = []

    def guide(state, parameters, mean):
        asked.append((state, parameters))
        return mean

    made_for = request()
    Planner(PlannerConfig(iterations=3), ACTIONS, 0, guide).plan(made_for, Bowl())
    ((state, parameters),) = asked
    assert state is made_for.state
    assert parameters is made_for.cost.parameters


def test_the_only_candidate_is_the_last_plan():
    config = PlannerConfig(rollouts=1)
    drawn, guided = asked_with(None, config), asked_with(walks, config)
    assert np.array_equal(guided[0], drawn[0])


def test_a_walk_that_costs_least_is_the_plan():
    def far_from_the_walk(_request, _iteration, knots):
        return evaluation(((knots[:, -4:, :3] - WALK) ** 2).sum(axis=(1, 2)))

    planner = Planner(PlannerConfig(), ACTIONS, 0, walks)
    plan = planner.plan(request(), far_from_the_walk).plan
    assert plan.knots[1:, :3] == pytest.approx(WALK)


PROPOSED = 0.5  # by the guide below, everywhere


def half(state, parameters, mean):
    """Propose the same whatever the state."""
    return np.full_like(mean, PROPOSED)


def candidates(rollouts, guide=half, number=1, **settings):
    """The first candidates of a plan that follows another one, and what they are drawn with."""
    bowl, config = Bowl(), PlannerConfig(rollouts=rollouts, **settings)
    planner = Planner(config, ACTIONS, 3, guide)
    previous = replace(previous_plan(), knots=np.zeros((4, N), np.float32))
    planner.plan(request(number, tick=2, previous=previous), bowl)
    return bowl.asked[0]


EASY = {"spline": "linear", "nodes": 4, "variance_first": 0.001, "variance_last": 0.01}


@pytest.mark.parametrize(
    ("guided", "rollouts", "proposals"),
    [
        (0.0, 16, 1),
        (0.01, 16, 1),
        (0.25, 16, 4),
        (0.5, 5, 2),
        (0.99, 8, 7),
        (1.0, 8, 8),
        (1.0, 1, 1),
        (0.9, 1, 0),
        (0.0, 1, 0),
    ],
)
def test_the_last_candidates_are_proposals(guided, rollouts, proposals):
    knots = candidates(rollouts, guided=guided, **EASY)
    usual = candidates(rollouts, guide=None, **EASY)
    rest = rollouts - proposals
    assert np.array_equal(knots[:rest], usual[:rest])
    if proposals:
        assert np.all(knots[rest] == PROPOSED)
        noise = knots[rest + 1 :] - PROPOSED
        assert noise == pytest.approx(usual[rest + 1 :], abs=1e-6)  # which is around zero
        assert all(np.abs(row).max() > 0.01 for row in noise)


def test_a_learned_policys_proposals_have_noise_unless_it_is_alone():
    learned = {"guidance": "learned", "policy": "policy.onnx", **EASY}
    beside = candidates(8, guided=0.25, **learned)[6:] - PROPOSED
    assert all(np.abs(row).max() > 0.01 for row in beside)
    assert np.all(candidates(8, guided=1.0, **learned)[0] == PROPOSED)


def test_proposals_near_their_mean_have_a_share_of_the_noise():
    near = {"guided": 0.5, "placement": "near"}
    knots = candidates(16, **near, **EASY)[9:] - PROPOSED
    usual = candidates(16, guided=0.5, **EASY)[9:] - PROPOSED
    for row, (mine, whole) in enumerate(zip(knots, usual, strict=True), 9):
        assert mine == pytest.approx(whole / (1 if row % 2 else 3), abs=1e-6)


def test_proposals_stay_within_the_limits():
    wild = {**EASY, "variance_first": 4.0, "variance_last": 4.0}
    knots = candidates(16, guide=lambda state, parameters, mean: mean + 3.0, guided=1.0, **wild)
    assert np.all(knots[0] == 1.0)
    assert knots.min() >= -1.0 and knots.max() <= 1.0


def test_what_is_not_searched_is_not_proposed_either():
    smooth = candidates(8, guided=0.5)
    limbs = ~ACTIONS.base
    assert np.all(smooth[4:, :2][..., limbs] == smooth[0, :2][:, limbs])
    assert np.all(smooth[4, 2:] == PROPOSED)


def test_later_iterations_have_no_proposals():
    bowl = Bowl()
    config = PlannerConfig(rollouts=12, iterations=2, guided=1.0, **EASY)
    Planner(config, ACTIONS, 3, half).plan(request(), bowl)
    first, second = bowl.asked
    assert np.all(first[0] == PROPOSED)
    assert not any(np.all(row == PROPOSED) for row in second[1:])


def test_one_proposal_alone_is_the_plan():
    config = PlannerConfig(
        rollouts=1, guided=1.0, nodes=1, spline="zero", horizon=0.06, optimizer="ps"
    )
    result = Planner(config, ACTIONS, 3, half).plan(request(), Bowl())
    assert np.array_equal(result.plan.knots, np.full((1, N), PROPOSED, np.float32))
    lost = Planner(config, ACTIONS, 3, half).plan(request(), all_lost)
    assert lost.failed
    assert np.allclose(ACTIONS.physical(lost.plan.knots), ACTIONS.default)
