"""The optimizer: which question it answers, which episodes it takes up, and what it refuses."""

import itertools
import queue
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace

import numpy as np
import pytest

from sumo_dist.dispatch.evaluator import RESEND_S, RemoteEvaluator
from sumo_dist.dispatch.questions import QuestionSlot
from sumo_dist.episode.assemble import make_plant
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.rollout import engine_identity
from sumo_dist.services.optimizer import OptimizerOptions, OptimizerServer, run
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import (
    EpisodeInfo,
    NoPlan,
    PlanMessage,
    Question,
    RolloutReply,
    RolloutRequest,
)
from sumo_dist.wire.notices import Event, Health, WorkerHealth

TASK = load_task("spot/move_box")
COST = TASK.table.defaults
STATE = np.array(make_plant(EpisodeConfig(TASK.name, 1), TASK).truth)
MEMORY = np.zeros(12, np.float32)


@pytest.fixture(scope="module")
def episode(config):
    return EpisodeConfig(TASK.name, planner=config)


@pytest.fixture(scope="module")
def info(episode, problem):
    return EpisodeInfo("run", episode.to_json(), problem.hash, 1)


@pytest.fixture(scope="module")
def question(config):
    """Return a function: a question, by default the first one in lockstep."""

    def question(tick=0, number=0, **changes):
        given = Question(
            *("run", number, tick, "lockstep", 1.0, STATE, MEMORY, None),
            *(COST.weights, COST.parameters, asdict(config)),
        )
        return replace(given, **changes)

    return question


@pytest.fixture
def realtime(question):
    def realtime(tick, speed, **changes):
        return question(tick, -1, clock="realtime", speed=speed, **changes)

    return realtime


class Ends:
    def __init__(self, stack, endpoint, robot, question):
        self._question = question
        self.other = stack.enter_context(Bus.dial(endpoint, robot))
        self.slot = QuestionSlot(stack.enter_context(Bus.dial(endpoint, robot, run="run")))
        self.meet()

    def meet(self):
        """Speak until heard: what is said before the router knows both ends is lost."""
        deadline = time.monotonic() + 30.0
        while self.heard(timeout=0.05) is None:
            assert time.monotonic() < deadline, "the slot hears nothing"
            self.say(self._question())
        while self.heard(timeout=0.2) is not None:
            pass  # what was said twice

    def say(self, *messages):
        for message in messages:
            self.other.publish(message)

    def heard(self, timeout=5.0):
        """Tick of the question that comes out; None if there is none."""
        _, question = self.slot.wait(timeout)
        self.speed = question.speed if question else None
        return question.tick if question else None

    def hears(self, question):
        """Say a realtime question; return the speed that comes out."""
        self.say(question)
        assert self.heard() == question.tick
        return self.speed


@pytest.fixture
def ends(router, robot, question):
    with ExitStack() as stack:
        yield Ends(stack, router, robot, question)


def test_a_question_is_handed_out_once_and_again_when_asked_again(ends, question):
    ends.say(question(4))
    assert ends.heard() == 4
    assert ends.heard(timeout=0.05) is None
    ends.say(question(4))  # the robot has missed the answer
    assert ends.heard() == 4


def test_only_the_newest_question_counts(ends, question):
    ends.say(question(4), question(5))
    time.sleep(0.3)
    assert ends.heard() == 5
    assert ends.heard(timeout=0.05) is None


def test_the_newest_episode_comes_with_the_question(ends, question, info):
    """Whatever the run that the bus is in: it may be the first that is heard of."""
    ends.say(info, replace(info, run="next"), question(run="next"))
    time.sleep(0.3)
    told, asked = ends.slot.wait(5.0)
    assert (told.run, asked.run) == ("next", "next")
    assert ends.slot.wait(0.05) == (None, None)


def test_a_speed_counts_once_two_questions_in_a_row_have_said_it(ends, realtime):
    def hears(*pairs):
        return [ends.hears(realtime(tick, speed)) for tick, speed in pairs]

    assert hears((1, 0.25), (2, 0.25)) == [0.0, 0.25]
    assert hears((3, 1e-300), (4, 0.25)) == [0.25, 0.25]
    assert hears((5, 100.0), (5, 100.0)) == [0.25, 0.25]
    assert hears((6, 0.0), (7, 0.0)) == [0.25, 0.0]


class OnBus:
    """An optimizer that serves on a thread, and one worker that may lose answers."""

    def __init__(self, stack, endpoint, robot):
        self.plans, self.loses, self._stop = [], lambda _asked: False, threading.Event()
        self.bus = stack.enter_context(Bus.dial(endpoint, robot))
        self.came = []
        self.bus.subscribe(PlanMessage, self._on_plan)
        self.events = self.bus.inbox(Event)
        self.health = self.bus.newest(Health, "optimizer")
        self.terms = len(TASK.cost)  # of a row
        self.blames = ""  # what of the task raises
        self.no_plan = self.bus.inbox(NoPlan)
        self.add_worker("w")
        options = OptimizerOptions(connect=endpoint, robot=robot)
        self._optimizer = threading.Thread(target=run, args=(options, self._stop))
        self._optimizer.start()
        stack.callback(self._optimizer.join)
        stack.callback(self._stop.set)

    def add_worker(self, name):
        self.bus.subscribe(RolloutRequest, self._answer, address=name)
        self.bus.announce("worker", name, engine_identity("auto")[1])

    def _on_plan(self, plan):
        self.came.append(time.monotonic())
        self.plans.append(plan)

    def _answer(self, asked):
        if self.loses(asked):
            return
        rows = len(asked.knots)
        who = asked.run, asked.worker, asked.asker
        what = asked.number, asked.iteration, asked.shard, asked.start
        costs = np.zeros((rows, self.terms)), np.ones(rows, bool)
        self.bus.publish(RolloutReply(*who, *what, *costs, 1.0, self.blames, bool(self.blames)))

    def plan(self, info, question):
        """Tell of an episode and ask until there is a plan of it; return the plan."""
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            self.bus.publish(info)
            self.bus.publish(question)
            time.sleep(0.1)
            for plan in self.plans:
                if (plan.run, plan.plan.number) == (question.run, question.number):
                    return plan
        raise AssertionError(f"no plan {question.number} of {question.run}")

    def said(self):
        texts = []
        while not self.events.empty():
            texts.append(self.events.get().text)
        return texts


@pytest.fixture
def optimizer(router, robot):
    with ExitStack() as stack:
        yield OnBus(stack, router, robot)


def test_one_question_of_a_tiny_speed_does_not_make_a_plan_wait(optimizer, info, realtime):
    """Else a plan whose answers are lost waits for them instead of its deadline."""
    optimizer.loses = lambda asked: asked.reply_budget_ms > 1e4
    deadline = time.monotonic() + 90.0
    for tick in itertools.count():
        optimizer.bus.publish(info)
        optimizer.bus.publish(realtime(tick, 1e-300 if tick % 7 == 0 else 0.25))
        time.sleep(0.08)
        assert time.monotonic() < deadline
        if len(optimizer.came) > 12:
            break
    waits = np.diff(optimizer.came)
    assert np.median(waits) < RESEND_S
    assert max(plan.plan_ms for plan in optimizer.plans) < 1e3 * RESEND_S


def test_plans_are_made_for_when_the_robot_will_have_them(optimizer, info, realtime):
    """Here it takes a plan and the next question three ticks to get across."""
    way, tick_s, speed = 0.24, 0.08, 0.25
    deadline, ahead = time.monotonic() + 60.0, []
    for tick in itertools.count():
        assert time.monotonic() < deadline, f"plans are {ahead} ticks ahead"
        now, echo = time.monotonic(), {}
        there = [(n, at) for n, at in enumerate(list(optimizer.came)) if at + way <= now]
        if there:  # the newest plan that such a robot has, and since when
            index, at = there[-1]
            echo["heard"] = optimizer.plans[index].plan.number
            echo["held_ms"] = (now - at - way) * 1e3
        optimizer.bus.publish(info)
        optimizer.bus.publish(realtime(tick, speed, **echo))
        before = len(optimizer.plans)
        time.sleep(tick_s)
        ahead += [plan.plan.tick - tick for plan in optimizer.plans[before:]]
        if len(there) > 9 and min(ahead[-3:]) >= 3 and optimizer.plans[-1].age_ticks >= 3:
            break


def test_a_task_that_raises_is_passed_on_until_the_next_episode(optimizer, info, question):
    """Again and again: the robot may have missed it."""
    optimizer.plan(info, question())
    optimizer.blames = "cost term 'mine': mine.py, line 3"
    deadline, told = time.monotonic() + 60.0, []
    while len(told) < 3:
        assert time.monotonic() < deadline
        optimizer.bus.publish(question(3, 1))
        with suppress(queue.Empty):
            told.append(optimizer.no_plan.get(timeout=0.2))
    assert {(message.run, message.reason) for message in told} == {("run", optimizer.blames)}
    optimizer.blames = ""
    optimizer.plan(replace(info, run="next", number=2), question(run="next"))


def test_a_plan_says_what_it_was_made_with(optimizer, info, question):
    weights, parameters = 2.0 * COST.weights, COST.parameters.copy()
    parameters[0] = 1.5
    plan = optimizer.plan(info, question(weights=weights, parameters=parameters))
    assert np.array_equal(plan.weights, weights)
    assert np.array_equal(plan.parameters, parameters)


def test_settings_count_from_the_question_on(optimizer, info, question, config):
    assert len(optimizer.plan(info, question()).costs) == config.rollouts
    settings = asdict(replace(config, rollouts=17, timestep=0.01))
    plan = optimizer.plan(info, question(3, 1, settings=settings))
    assert len(plan.costs) == 17


def test_what_was_asked_for_twice_is_answered_with_the_same_plan(optimizer, info, question):
    first = optimizer.plan(info, question())
    before = len(optimizer.plans)
    deadline = time.monotonic() + 30.0
    while len(optimizer.plans) < before + 3:
        assert time.monotonic() < deadline
        optimizer.bus.publish(question())
        time.sleep(0.05)
    for plan in optimizer.plans:
        assert np.array_equal(plan.plan.knots, first.plan.knots)


FOLLOWED = Plan(0, 0, np.zeros((4, 9), np.float32), 0.4, "linear")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"state": np.zeros(3)}, "state and memory have (3, 12) numbers, this robot's have (64, "),
        ({"state": np.full(64, 1e300)}, "state or memory is beyond 1e+10"),
        ({"memory": np.zeros(3, np.float32)}, "state and memory have (64, 3) numbers"),
        ({"weights": np.ones(2)}, "weights and parameters have shapes"),
        ({"parameters": np.ones(2)}, "weights and parameters have shapes"),
        ({"parameters": np.full(4, 1e9)}, "parameter 'goal' must be from -8 to 8 m"),
        ({"settings": {"rollouts": 3}}, "planner settings of another version"),
        (
            {"followed": replace(FOLLOWED, knots=np.zeros((4, 25), np.float32))},
            "the followed plan is none of this robot: its knots have 25 numbers",
        ),
        (
            {"followed": replace(FOLLOWED, knots=np.full((4, 9), 3.0, np.float32))},
            "the followed plan is none of this robot: an action of 3",
        ),
    ],
)
@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_a_question_that_makes_no_sense_is_refused_by_name_and_those_after_it_answered(
    optimizer, info, question, eventually, changes, reason, clock
):
    """None of it reaches the workers: they would refuse it, and be left out for that."""
    optimizer.plan(info, question())
    optimizer.said()
    spoilt = changes if clock == "lockstep" else {**changes, "clock": clock, "number": -1}
    told = []

    def refused():
        for tick in (5, 10):  # two in a row: a realtime speed counts from the second on
            optimizer.bus.publish(question(tick, **{"number": 2 * tick // 5, **spoilt}))
            time.sleep(0.05)
        told.extend(optimizer.said())
        return told

    assert eventually(refused, 30.0)
    assert "a plan that cannot be made: " in told[0]
    assert reason in told[0]
    optimizer.plan(info, question(100, 40))
    assert eventually(lambda: optimizer.health.wait(10.0).counters["refused"] > 0, 10.0)
    assert optimizer.health.peek().counters["workers"] == 1


# What an episode must have here that the robot has, and what becomes of one that has not.


def test_a_task_that_differs_from_the_robots_is_told_by_name_each_time(
    optimizer, info, question, problem, eventually
):
    optimizer.plan(info, question())
    for bad in ("bad.1", "bad.2"):
        optimizer.said()
        told = []

        def refused(bad=bad, told=told):
            optimizer.bus.publish(replace(info, run=bad, task_hash="0123"))
            optimizer.bus.publish(question(run=bad))
            told.extend(optimizer.said())
            time.sleep(0.05)
            return told

        assert eventually(refused, 30.0)
        assert (
            f"its spot/move_box has hash {problem.hash}, the robot's has 0123: "
            "the task's files differ between the hosts" in told[0]
        )
    assert not [plan for plan in optimizer.plans if plan.run != "run"]
    optimizer.plan(replace(info, run="good.1"), question(run="good.1"))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"task": "spot/none"}, "unknown task 'spot/none'; valid: "),
        ({"task": "/nowhere/task.py"}, "/nowhere/task.py does not exist on this host"),
        (None, "this is no episode's configuration"),
    ],
)
def test_an_episode_that_cannot_be_taken_up_is_told_and_the_next_one_is(
    optimizer, info, question, episode, eventually, changes, reason
):
    config = "nonsense" if changes is None else replace(episode, **changes).to_json()
    told = []

    def refused():
        optimizer.bus.publish(replace(info, run="bad.1", config=config))
        told.extend(optimizer.said())
        time.sleep(0.05)
        return any(reason in text for text in told)

    assert eventually(refused, 30.0), told
    optimizer.plan(info, question())


def test_it_serves_one_episode_after_another_of_other_tasks(optimizer, info, question):
    """Each is built for its own task; nothing of the one before is left."""
    optimizer.plan(info, question())
    tire = load_task("spot/move_tire")
    start = np.array(make_plant(EpisodeConfig("spot/move_tire"), tire).truth)
    config = EpisodeConfig("spot/move_tire", planner=EpisodeConfig.from_json(info.config).planner)
    other = Problem.build(tire, planning_options(config.planner))
    next_info = EpisodeInfo("next.1", config.to_json(), other.hash, 1)
    terms = tire.table.defaults
    optimizer.terms = len(terms.weights)
    asked = replace(
        question(run="next.1"), state=start, weights=terms.weights, parameters=terms.parameters
    )
    assert len(optimizer.plan(next_info, asked).terms) == len(terms.weights)
    optimizer.terms = len(TASK.cost)
    optimizer.plan(replace(info, run="last.1"), question(run="last.1"))


def test_it_tells_of_each_of_many_workers_and_its_own_health_stays_short(
    router, robot, info, question, eventually
):
    with ExitStack() as stack:
        optimizer = OnBus(stack, router, robot)
        heard, healths = {}, []
        optimizer.bus.subscribe(WorkerHealth, lambda m: heard.update({w.worker: w for w in m.told}))
        optimizer.bus.subscribe(Health, healths.append)
        names = [f"{'a-host-of-a-very-long-name-in-a-far-away-rack':.55}-{i}" for i in range(20)]
        for name in names:
            optimizer.add_worker(name)
        optimizer.plan(info, question())
        assert eventually(lambda: {*names, "w"} <= set(heard), 30.0)
        plans = itertools.count(1)

        def all_answer():  # a plan's rows are few: the workers show themselves one after another
            number = next(plans)
            optimizer.plan(info, question(10 * number, 4 * number))
            return all(health.state == "answers" for health in heard.values())

        assert eventually(all_answer, 60.0)
        assert eventually(lambda: healths[-1].counters["workers"] == 21, 30.0)
        assert all(h.rollouts_per_s > 0 and h.silent_s >= 0 for h in heard.values())
        assert optimizer.bus.rejected == {}


def test_a_server_takes_up_an_episode_once(router, robot, info, question, monkeypatch):
    """The robot says it again whenever it repeats a question."""
    told, built = [], []
    with Bus.dial(router, robot) as bus:
        evaluator = RemoteEvaluator(
            bus, "one", "build", threading.Event(), lambda *t: told.append(t)
        )
        options = OptimizerOptions(connect=router, robot=robot)
        with OptimizerServer(options, bus, evaluator, lambda *t: told.append(t)) as server:
            build = Problem.build
            monkeypatch.setattr(Problem, "build", lambda *a: built.append(a) or build(*a))
            server.enter(info)
            server.enter(info)
            assert len(built) == 1
            with pytest.raises(SumoError, match="the task's files differ"):
                server.enter(replace(info, run="bad", task_hash="0123"))
            assert bus.run == "bad"
            server.handle(question(run="bad"), 0.0)  # of an episode that is not taken up
            server.enter(replace(info, run="good"))
    assert told == []
