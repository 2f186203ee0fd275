"""What arrives unasked: nothing of it ends a robot, and who is wrong here is told by name."""

import time
from contextlib import ExitStack
from dataclasses import asdict, replace

import numpy as np
import pytest

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.rollout import engine_identity
from sumo_dist.tasks import load_task
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import EpisodeInfo, PlanMessage, Question, State
from sumo_dist.wire.notices import Health

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

SPEED = 0.3  # of the wall clock in realtime
GHOSTS = 300
# Of late plans with ten candidates of 0.4 s a joint may be faster than the guard lets it.
CALM = PlannerConfig(rollouts=4, horizon=0.6)
COST = load_task("spot/move_box").table.defaults
TERMS, PARAMETERS = len(COST.weights), len(COST.parameters)
BOTH = pytest.mark.parametrize(
    "clock", ["lockstep", pytest.param("realtime", marks=pytest.mark.alone)]
)


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


def options(clock, **changes):
    return {"clock": clock, "speed": SPEED if clock == "realtime" else None, "time_limit": 2.0} | (
        changes
    )


@pytest.fixture
def start(robot_starts):
    return lambda clock, **changes: robot_starts(**options(clock, **changes))


def digests(summary):
    return summary["plan_digest"], summary["state_digest"]


def plan(run, number, nodes=5, terms=TERMS, actions=9):
    knots = np.full((nodes, actions), 0.9, np.float32)
    made = Plan(number, anchor_tick(number), knots, 0.4, "linear")
    costs = np.zeros(3), np.ones(3, bool)
    numbers = np.zeros(terms), np.ones(terms), np.zeros(PARAMETERS)
    return PlanMessage.of(run, PlanReport(made, *costs, *numbers, 1.0, 1.0))


def one_term_more(system, number):
    return plan(system.run_id, number, terms=TERMS + 1)


def other_nodes(system, number):
    return plan(system.run_id, number, nodes=4)


def of_another_robot(system, number):
    return plan(system.run_id, number, actions=25)


def from_far_ahead(system, number):
    del number
    return plan(system.run_id, 10_000)


def a_state_of_another_size(system, number):
    return State(system.run_id, anchor_tick(number), np.zeros(57))


def a_state_from_the_future(system, number):
    return State(system.run_id, anchor_tick(number) + 2000, np.zeros(64))


def an_episode_of_somebody_else(system, number):
    config = EpisodeConfig("spot/move_tire").to_json()
    return EpisodeInfo(f"somebody-else.{number}", config, "0123", 1)


LIES = (
    *(one_term_more, other_nodes, of_another_robot, from_far_ahead),
    *(a_state_of_another_size, a_state_from_the_future, an_episode_of_somebody_else),
)


@BOTH
def test_what_does_not_fit_is_refused_by_name_and_the_run_goes_on(
    start, expected_digests, eventually, clock
):
    """Each of them, again and again; tests/dispatch/test_robot_link.py has what is said of each."""
    system = start(clock)
    system.after_plan(5)
    with Bus.dial(system.endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        for _ in range(3):
            for lie in LIES:
                bus.publish(lie(system, system.newest_plan + 1))
                time.sleep(0.02)

        def counted():
            bus.publish(one_term_more(system, system.newest_plan + 1))
            time.sleep(0.05)
            return health.peek() and health.peek().counters["refused"] > len(LIES)

        assert eventually(counted, 60.0)
        assert system.said("robot", "is refused")
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    recording = system.recording()
    assert max(recording.plan_numbers) < 10_000
    assert np.array(recording.states)[:, 2].min() > 0.4
    if clock == "lockstep":
        assert digests(summary) == expected_digests(time_limit=2.0)
    else:
        assert recording.plan_numbers[-1] >= 30


def test_questions_of_somebody_else_cost_no_worker(start, eventually, config, expected_digests):
    """Of states that the workers would refuse they do not hear: they would be left out for it."""
    system = start("lockstep")
    system.after_plan(5)
    with Bus.dial(system.endpoint, "spot") as bus:
        question = Question(
            *(system.run_id, 0, 0, "lockstep", 1.0, np.zeros(57), np.zeros(12, np.float32), None),
            *(COST.weights, COST.parameters, asdict(config)),
        )

        def refused():
            for wrong in (
                question,
                replace(question, state=np.zeros(64), memory=np.zeros(3, np.float32)),
                replace(question, state=np.full(64, 1e300)),
                replace(question, state=np.zeros(64), weights=np.zeros(2)),
                replace(question, run="somebody-else.1"),
            ):
                bus.publish(wrong)
                time.sleep(0.02)
            return system.said("optimizer", "a plan that cannot be made: ")

        assert eventually(refused, 60.0)
        refused()
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert not system.said("optimizer", "is left out")
    assert digests(summary) == expected_digests(time_limit=2.0)


# Two of a kind


def test_a_second_robot_of_the_same_name_ends_with_an_error_that_says_so(start, capfd, tmp_path):
    system = start("lockstep", time_limit=60.0)
    system.after_plan(3)
    with system.held():  # else it has fallen before the second has come
        second = system.start_like("robot-interface", "second", out=tmp_path / "second")
        assert second.wait(60.0) == 3
    said = f"a robot named 'spot' is at {system.endpoint} already: end it, or give this one another"
    assert said in capfd.readouterr().err
    assert not (tmp_path / "second").exists()
    system.after_more_plans(5)
    system.interrupt()
    assert system.episodes == 1


def test_a_second_worker_of_the_same_name_ends_with_an_error_that_says_so(
    start, capfd, expected_digests
):
    system = start("lockstep")
    system.after_plan(3)
    with system.held():
        second = system.start_like("local-0", "second")
        assert second.wait(60.0) == 3
    said = f"a worker named 'local-0' is at {system.endpoint} already: give this one another"
    assert said in capfd.readouterr().err
    code, summary = system.finish()
    assert (code, digests(summary)) == (1, expected_digests(time_limit=2.0))


def test_a_second_optimizer_is_told(start, eventually):
    system = start("lockstep", time_limit=60.0)
    system.after_plan(3)
    with system.held():
        system.start_like("optimizer", "second")
        assert eventually(lambda: system.said("robot", "2 optimizers plan for it: "), 60.0)
    system.after_more_plans(5)
    system.interrupt()
    assert np.array(system.recording().states)[:, 2].min() > 0.4


# Many tokens


@pytest.fixture
def haunt():
    """Return a function: tokens of workers whose build fits, and who never answer."""
    with ExitStack() as stack:

        def haunt(system):
            bus = stack.enter_context(Bus.dial(system.endpoint, "spot"))
            for number in range(GHOSTS):
                bus.announce("worker", f"ghost-{number}", engine_identity()[1])

        yield haunt


def test_ghosts_that_were_there_before_two_real_workers_cost_nothing(
    run_system, haunt, expected_digests
):
    """Whoever answers is found among them."""
    system = run_system(**options("lockstep"), starts_robot=False)
    for name in ("local-0", "local-1", "optimizer"):
        system.kill(name)
    haunt(system)
    for name in ("optimizer", "local-0", "local-1", "robot-interface"):
        system.start_again(name)
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    assert digests(summary) == expected_digests(time_limit=2.0)
    assert sum(system.recording().reissued[10:]) == 0


@pytest.mark.alone
def test_ghosts_that_come_while_two_real_workers_plan_cost_nothing(start, haunt):
    system = start("realtime", planner=CALM)
    system.after_plan(3)
    haunt(system)
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    recording = system.recording()
    assert recording.plan_numbers[-1] >= 30
    assert np.isfinite(recording.costs[-1]).any()
    assert np.array(recording.states)[:, 2].min() > 0.4
