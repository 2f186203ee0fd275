"""Rollouts on workers across a real bus; the workers here are scripted, to misbehave on purpose."""

import queue
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from sumo_dist.dispatch import evaluator as gather
from sumo_dist.dispatch import workers as crew
from sumo_dist.dispatch.evaluator import RemoteEvaluator
from sumo_dist.errors import Interrupted, TaskError
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import RolloutRequest
from sumo_dist.wire.notices import WorkerHealth

BUILD = "build-1"
COST = load_task("spot/move_box").table.defaults
TERMS = len(COST.weights)
KNOTS = np.arange(10 * 4 * 9, dtype=np.float32).reshape(10, 4, 9)
EXPECTED = KNOTS[:, 0, 0].astype(float)  # a row's first term, as the scripted workers compute it


def request(number=0):
    return PlanRequest(number, 0, np.zeros(64), np.zeros(12, np.float32), None, COST)


def answer(asked, **changes):
    """Answer a request: the first term of a row is a number of its knots, all others are 0."""
    terms = np.zeros((len(asked.knots), TERMS))
    terms[:, 0] = asked.knots[:, 0, 0]
    reply = asked.reply(terms, np.ones(len(terms), bool), float(len(terms)))
    return replace(reply, **changes)


class Worker:
    """A worker on the bus that answers by a script: request -> reply or None."""

    def __init__(self, endpoint, robot, name, script=answer, build=BUILD):
        self.name, self.script, self.asked = name, script, []
        self.bus = Bus.dial(endpoint, robot)
        self.bus.subscribe(RolloutRequest, self._serve, address=name)
        self.bus.announce("worker", name, build)

    def _serve(self, asked):
        self.asked.append(asked)
        reply = self.script(asked)
        if reply is not None:
            self.bus.publish(reply)


class Inbox(queue.SimpleQueue):
    """A queue that counts what has come, whether it was read or not."""

    def __init__(self):
        self.came, self._lock = 0, threading.Lock()

    def put(self, item):
        super().put(item)
        with self._lock:
            self.came += 1


class Party:
    """An evaluator and its workers, on one bus."""

    def __init__(self, stack, endpoint, robot, problem, config, eventually):
        self.stack, self.endpoint, self.robot = stack, endpoint, robot
        self._eventually = eventually
        self.told = []
        self.stop = threading.Event()
        bus = stack.enter_context(Bus.dial(endpoint, robot, run="run"))
        self.bus, self.problem, self.config = bus, problem, config
        self._inbox = Inbox()
        with patch.object(gather.queue, "SimpleQueue", lambda: self._inbox):
            self.evaluator = RemoteEvaluator(
                bus, "one", BUILD, self.stop, lambda *told: self.told.append(told)
            )
        self.workers = self.evaluator.workers

    def worker(self, name, script=answer, build=BUILD):
        worker = Worker(self.endpoint, self.robot, name, script, build)
        self.stack.callback(worker.bus.close)
        return worker

    def join(self, *args, **kwargs):
        """Add a worker; return when the evaluator has heard of it."""
        with self.news():
            return self.worker(*args, **kwargs)

    @contextmanager
    def news(self, count=1):
        """Wait until what happens inside has reached the evaluator, which reads it later."""
        before = self._inbox.came
        yield
        assert self._eventually(lambda: self._inbox.came >= before + count, 30.0)

    def evaluate(self, number=0, deadline_s=None):
        deadline = None if deadline_s is None else time.monotonic() + deadline_s
        self.evaluator.begin(self.problem, self.config, deadline)
        return self.evaluator(request(number), 0, KNOTS)

    def rows_per_ms(self):
        return sum(pace.rows_per_ms for pace in self.workers.asked().values())

    def heard(self, text):
        return any(text in said for _, said in self.told)


@pytest.fixture
def party(router, robot, problem, config, eventually):
    with ExitStack() as stack:
        yield Party(stack, router, robot, problem, config, eventually)


def silent(asked):
    return None


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_every_row_comes_back_in_its_place(party, workers):
    members = [party.join(f"w-{i}") for i in range(workers)]
    evaluation = party.evaluate()
    assert np.array_equal(evaluation.terms[:, 0], EXPECTED)
    assert evaluation.answered.all()
    assert evaluation.valid.all()
    rows = sorted(row for m in members for a in m.asked for row in a.knots[:, 0, 0])
    assert np.array_equal(rows, EXPECTED)
    assert all(member.asked for member in members)
    assert (party.evaluator.reissued, len(party.workers)) == (0, workers)


def test_a_request_says_all_that_a_worker_must_know(party, problem, config):
    worker = party.join("w-1")
    party.evaluate(number=7)
    (asked,) = worker.asked
    assert (asked.task, asked.task_hash, asked.build) == ("spot/move_box", problem.hash, BUILD)
    assert (asked.number, asked.iteration, asked.start) == (7, 0, 0)
    assert asked.reply_budget_ms == 0.0  # in lockstep an answer is never too late
    assert asked.settings["rollouts"] == config.rollouts


def test_a_request_says_its_robots_priority(party):
    worker = party.join("w-1")
    evaluator = RemoteEvaluator(party.bus, "two", BUILD, party.stop, lambda *_: None, priority=-3)
    evaluator.begin(party.problem, party.config)
    evaluator(request(), 0, KNOTS)
    assert {asked.priority for asked in worker.asked} == {-3}


def test_waits_for_a_worker_to_join(party):
    timer = threading.Timer(0.3, lambda: party.worker("w-1"))
    timer.start()
    assert np.array_equal(party.evaluate().terms[:, 0], EXPECTED)
    timer.join()


def test_gives_the_shards_of_a_silent_worker_to_another(party, monkeypatch):
    monkeypatch.setattr(gather, "RESEND_S", 0.2)
    mute, good = party.join("mute", silent), party.join("good")
    evaluation = party.evaluate()
    assert np.array_equal(evaluation.terms[:, 0], EXPECTED)
    assert party.evaluator.reissued >= len(mute.asked[0].knots)
    assert len(good.asked) >= 2


@pytest.mark.alone
def test_gives_the_shards_of_a_worker_that_leaves_to_another_at_once(party):
    leaving = party.join("leaving", silent)
    party.join("good")
    threading.Timer(0.1, leaving.bus.close).start()
    began = time.monotonic()
    assert np.array_equal(party.evaluate().terms[:, 0], EXPECTED)
    assert time.monotonic() - began < 0.9 * gather.RESEND_S
    assert party.heard("worker leaving left")


def test_passes_over_a_worker_that_does_not_answer_and_asks_again_later(party, monkeypatch):
    monkeypatch.setattr(crew, "PROBE_S", 1e3)
    mute = party.join("mute")
    party.join("good")
    party.evaluate(0)
    mute.script = silent
    for number in range(1, 1 + crew.MISSES_TO_SUSPEND):
        assert party.evaluate(number, deadline_s=0.5).answered.any()
    assert party.heard("worker mute does not answer: it is passed over")
    asked = len(mute.asked)
    assert party.evaluate(3, deadline_s=5.0).answered.all()
    assert len(mute.asked) == asked
    mute.script = answer
    monkeypatch.setattr(crew, "PROBE_S", 0.0)
    with party.news(2):  # one row is with both
        party.evaluate(4)
    assert [len(sent.knots) for sent in mute.asked[asked:]] == [1]
    party.evaluate(5)
    assert party.heard("worker mute answers again")
    party.evaluate(6)
    assert mute.asked[-1].number == 6


def test_a_worker_that_has_never_answered_gets_no_row_that_a_plan_needs(party, monkeypatch):
    """Only one that another has as well, and not with every plan."""
    party.join("good")
    party.evaluate(0)
    mute = party.join("mute", silent)
    began = time.monotonic()
    for number in range(1, 20):
        assert np.array_equal(party.evaluate(number).terms[:, 0], EXPECTED)
    took = time.monotonic() - began
    assert 1 <= len(mute.asked) <= 1 + took / crew.PROBE_S
    assert [len(asked.knots) for asked in mute.asked] == [1] * len(mute.asked)
    assert party.evaluator.reissued == 0
    assert not party.heard("does not answer")  # nobody counted on it
    assert (len(party.workers), party.workers.get("mute").lost) == (1, 0)


def test_a_newcomer_is_counted_on_from_its_first_answer(party):
    party.join("old")
    party.evaluate(0)
    new = party.join("new")
    with party.news(2):
        party.evaluate(1)
    assert [len(asked.knots) for asked in new.asked] == [1]
    party.evaluate(2)
    assert len(party.workers) == 2
    assert len(new.asked[-1].knots) > 1


@pytest.mark.parametrize("deadline_s", [None, 0.5])
def test_hundreds_of_tokens_whose_owners_are_silent_cost_nothing(party, deadline_s):
    """Such as of hosts that were cut off, or of somebody who means ill."""
    ghosts = Bus.dial(party.endpoint, party.robot)
    party.stack.callback(ghosts.close)
    with party.news(300):
        for i in range(300):
            ghosts.announce("worker", f"ghost-{i}", BUILD)
    good = [party.join(f"good-{i}") for i in range(2)]
    for number in range(10):  # until both have shown themselves
        party.evaluate(number, deadline_s)
        if party.evaluator.reissued == 0 and set(party.workers.asked()) == {"good-0", "good-1"}:
            break
    for number in range(1000, 1030):
        evaluation = party.evaluate(number, deadline_s)
        assert np.array_equal(evaluation.terms[:, 0], EXPECTED)
        assert party.evaluator.reissued == 0
    assert set(party.workers.asked()) == {worker.name for worker in good}


@pytest.mark.alone
def test_leaves_out_what_is_late(party):
    party.join("mute", silent)
    party.join("good")
    began = time.monotonic()
    evaluation = party.evaluate(deadline_s=0.2)
    assert time.monotonic() - began < 0.5
    lost = ~evaluation.answered
    assert 0 < lost.sum() < len(KNOTS)
    assert np.isinf(evaluation.costs(COST.weights)[lost]).all()
    assert np.array_equal(evaluation.terms[~lost, 0], EXPECTED[~lost])


@pytest.mark.alone
def test_without_workers_a_deadline_holds_too(party):
    began = time.monotonic()
    evaluation = party.evaluate(deadline_s=0.2)
    assert time.monotonic() - began < 0.5
    assert not evaluation.answered.any()
    assert np.isinf(evaluation.costs(COST.weights)).all()


def test_rows_that_diverged_are_answered_and_worst(party):
    def diverged(asked):
        valid = np.ones(len(asked.knots), bool)
        valid[0] = asked.start != 0
        return answer(asked, valid=valid)

    party.join("w-1", diverged)
    evaluation = party.evaluate()
    assert evaluation.answered.all()
    assert evaluation.costs(COST.weights)[0] == np.inf
    assert np.array_equal(evaluation.terms[1:, 0], EXPECTED[1:])


@pytest.mark.parametrize(
    "lie",
    [  # no part of a plan of ten has these
        {"terms": np.zeros((10, 7)), "valid": np.ones(10, bool)},
        {"terms": np.zeros((11, TERMS)), "valid": np.ones(11, bool)},
        {"start": 10},
    ],
)
def test_a_worker_whose_answer_does_not_fit_is_left_out(party, lie, monkeypatch):
    monkeypatch.setattr(crew, "PROBE_S", 0.0)
    party.join("liar", lambda asked: answer(asked, **lie))
    party.join("good")
    for number in range(50):
        assert np.array_equal(party.evaluate(number).terms[:, 0], EXPECTED)
        if party.heard("left out"):
            break
        time.sleep(0.01)
    assert party.heard("worker liar is left out: sent costs of shape")
    assert len(party.workers) == 1


def test_a_worker_that_refuses_is_left_out_with_its_reason(party):
    nothing = {"terms": np.empty((0, 0)), "valid": np.empty(0, bool)}
    party.join("w-1", lambda asked: answer(asked, **nothing, refusal="its task differs"))
    party.join("good")
    assert np.array_equal(party.evaluate().terms[:, 0], EXPECTED)
    assert party.heard("worker w-1 is left out: its task differs")


def test_one_refusal_that_was_spoilt_on_the_way_does_not_leave_a_worker_out(party):
    worker = party.join("w-1")

    def once(asked):
        worker.script = answer
        return answer(asked, refusal="x")

    worker.script = once
    assert np.array_equal(party.evaluate().terms[:, 0], EXPECTED)
    assert (len(party.workers), party.told) == (1, [("info", "worker w-1 joined")])


def test_a_worker_of_another_build_is_left_out_with_the_remedy(party):
    other = party.join("other", build="build-2")
    party.join("good")
    assert np.array_equal(party.evaluate().terms[:, 0], EXPECTED)
    assert not other.asked
    assert party.heard("worker other is left out: its build is build-2, here it is build-1")
    assert party.heard("give all of them --engine native-portable")


def test_a_refused_worker_is_welcome_after_a_restart(party):
    broken = party.join("w-1", lambda asked: answer(asked, start=asked.start + 1))
    party.join("good")
    party.evaluate(0)
    with party.news():
        broken.bus.close()
    mended = party.join("w-1")
    party.evaluate(1)
    assert party._eventually(lambda: mended.asked, 30.0)  # with a row that the other has as well


def test_answers_to_an_earlier_plan_do_not_count(party):
    worker = party.join("w-1")
    party.evaluate(number=0)
    (first,) = worker.asked
    wrong = np.full((10, TERMS), -1e9)

    def both(asked):
        worker.bus.publish(answer(first, terms=wrong))
        worker.bus.publish(answer(asked, number=0, terms=wrong))
        return answer(asked)

    worker.script = both
    assert np.array_equal(party.evaluate(number=1).terms[:, 0], EXPECTED)


def test_the_last_words_of_a_worker_that_left_do_not_bring_it_back(party):
    worker, leaving = party.join("w-1"), party.join("w-2")
    party.evaluate(0)
    with party.news():
        leaving.bus.close()
    party.evaluate(1)
    with party.news():
        worker.bus.publish(answer(leaving.asked[0]))
    assert np.array_equal(party.evaluate(2).terms[:, 0], EXPECTED)
    assert len(party.workers) == 1


def test_a_worker_that_came_back_as_another_build_survives_the_end_of_the_old_one(party):
    """The old one's token outlives it by the lease when its host was cut off."""
    old = party.join("w-1", build="build-0")
    party.join("w-1")
    with party.news():
        old.bus.close()
    assert np.array_equal(party.evaluate(deadline_s=2.0).terms[:, 0], EXPECTED)


def test_faster_workers_get_more_rows(party):
    party.join("slow", lambda asked: answer(asked, compute_ms=100.0 * len(asked.knots)))
    fast = party.join("fast")
    for number in range(20):
        party.evaluate(number)
    assert sum(len(asked.knots) for asked in fast.asked[-1:]) >= 9


def test_answers_that_come_too_late_tell_how_slow_a_worker_is(party):
    slow = party.join("slow", silent)
    party.evaluate(0, deadline_s=0.05)
    believed = party.rows_per_ms()
    with party.news():
        slow.bus.publish(answer(slow.asked[0], compute_ms=1000.0))
    party.evaluate(1, deadline_s=0.05)
    assert party.rows_per_ms() < 0.9 * believed


def test_a_worker_that_is_often_late_counts_for_less(party):
    def first(asked):  # 8 rows of 10; a row takes it so long that a request has one or two
        return answer(asked, compute_ms=10.0 * len(asked.knots)) if asked.start < 8 else None

    party.join("w-1", first)
    for number in range(30):
        party.evaluate(number, deadline_s=0.1)
    speed = party.workers.get("w-1").speed
    assert party.rows_per_ms() == pytest.approx(0.8 * speed, rel=0.1)


@pytest.mark.alone
def test_a_worker_behind_a_slow_link_gets_what_is_back_when_the_others_are_ready(party):
    def later(asked):
        threading.Timer(0.15, far.bus.publish, [answer(asked)]).start()

    near, far = party.join("near"), party.join("far", later)
    for number in range(3):
        party.evaluate(number)
    began = time.monotonic()
    for number in range(3, 13):
        assert np.array_equal(party.evaluate(number).terms[:, 0], EXPECTED)
    assert party.workers.get("far").turnaround.wait_ms > 100
    assert near.asked[-1].number == 12
    assert [a.number for a in far.asked if len(a.knots) > 1 and a.number > 3] == []
    assert time.monotonic() - began < 1.5  # ten plans that wait for it took that long


def test_a_worker_that_says_it_leaves_is_asked_no_more_and_its_answers_count(party):
    leaving = party.join("leaving", lambda asked: answer(asked, leaving=True))
    party.join("staying")
    assert np.array_equal(party.evaluate(0).terms[:, 0], EXPECTED)
    assert party.evaluator.reissued == 0
    asked = len(leaving.asked)
    for number in range(1, 5):
        assert np.array_equal(party.evaluate(number).terms[:, 0], EXPECTED)
    assert len(leaving.asked) == asked
    assert len(party.workers) == 1


def test_tells_of_each_worker_what_it_does_and_loses(party, eventually):
    party.join("w-1")
    party.join("lossy")
    party.evaluate(0)
    party.join("mute", silent)
    party.join("other", build="build-2")
    party.workers.get("lossy").lost = 7
    party.evaluate(1)
    told = {}
    with Bus.dial(party.endpoint, party.robot) as bus:
        bus.subscribe(WorkerHealth, lambda m: told.update({w.worker: w for w in m.told}))

        def all_told():
            party.workers.publish_health(party.bus, "one")
            time.sleep(0.05)
            return len(told) == 4

        assert eventually(all_told)
    assert (told["w-1"].state, told["w-1"].lost) == ("answers", 0)
    assert told["w-1"].rollouts_per_s > 0
    assert 0 <= told["w-1"].silent_s < 60
    assert (told["lossy"].state, told["lossy"].lost) == ("answers", 7)
    assert (told["mute"].state, told["mute"].silent_s) == ("has not answered yet", -1.0)
    assert told["other"].state.startswith("its build is build-2, here it is build-1")


def test_a_worker_that_refused_is_asked_again_for_another_task(party):
    worker = party.join("w-1", lambda asked: answer(asked, refusal="its task differs"))
    party.join("good")
    party.evaluate(0)
    assert party.heard("worker w-1 is left out: its task differs")
    worker.script = answer
    party.evaluate(1)
    assert worker.asked[-1].number == 0
    party.problem = replace(party.problem, hash="another")
    party.evaluate(2)
    party.evaluate(3)
    assert worker.asked[-1].number >= 2
    assert worker.asked[-1].task_hash == "another"


def test_a_worker_of_another_build_is_not_forgiven(party):
    other = party.join("other", build="build-2")
    party.join("good")
    party.evaluate(0)
    party.problem = replace(party.problem, hash="another")
    party.evaluate(1)
    assert not other.asked


def test_answers_to_another_optimizer_are_not_taken_for_ones_own(party, eventually):
    """Two of them ask the same workers for the same plan, each for other rows of it."""
    workers = [party.join(f"w-{i}") for i in range(2)]
    with Bus.dial(party.endpoint, party.robot, run="run") as bus:
        told = []
        other = RemoteEvaluator(bus, "other", BUILD, party.stop, lambda *text: told.append(text))
        assert eventually(lambda: other._inbox.qsize() == 2)
        for evaluator, fast in ((party.evaluator, "w-0"), (other, "w-1")):
            evaluator.begin(party.problem, party.config)
            evaluator(request(0), 0, KNOTS)
            evaluator.workers.get(fast).speed = 9.0
            evaluator.workers.get("w-1" if fast == "w-0" else "w-0").speed = 1.0
        for number in range(1, 8):
            asking = threading.Thread(target=party.evaluate, args=(number,))
            asking.start()
            other.begin(party.problem, party.config)
            assert np.array_equal(other(request(number), 0, KNOTS).terms[:, 0], EXPECTED)
            asking.join(30.0)
    assert not [text for _, text in (*told, *party.told) if "left out" in text]
    assert all(worker.asked for worker in workers)


def test_says_that_it_was_told_to_stop(party):
    threading.Timer(0.2, party.stop.set).start()
    with pytest.raises(Interrupted):
        party.evaluate()


def blames(asked):
    """What a worker answers on which the task's own code raises."""
    nothing = {"terms": np.zeros((0, 0)), "valid": np.zeros(0, bool)}
    return answer(asked, **nothing, refusal="cost term 'mine': mine.py, line 3", task_fails=True)


@pytest.mark.parametrize("workers", [1, 3])
def test_a_task_that_raises_on_every_worker_is_at_fault(party, workers):
    members = [party.join(f"w-{i}", blames) for i in range(workers)]
    with pytest.raises(TaskError, match=r"^cost term 'mine': mine.py, line 3$"):
        party.evaluate()
    assert all(member.asked for member in members)
    assert sum("is left out: cost term 'mine'" in text for _, text in party.told) == 1


def test_one_worker_that_blames_the_task_costs_no_more_than_its_rows(party):
    party.join("liar", blames)
    party.join("w-1")
    evaluation = party.evaluate()
    assert evaluation.answered.all()
    assert np.array_equal(evaluation.terms[:, 0], EXPECTED)
    assert party.evaluate(1).answered.all()
    assert party.heard("worker liar is left out: cost term 'mine'")


def test_a_worker_that_never_answers_does_not_keep_a_fault_from_being_told(party):
    party.join("w-1", blames)
    party.join("frozen", silent)
    with pytest.raises(TaskError, match=r"mine.py, line 3"):
        party.evaluate()


def test_workers_are_asked_again_once_they_are_forgiven(party):
    worker = party.join("w-1", blames)
    with pytest.raises(TaskError):
        party.evaluate()
    worker.script = answer
    with pytest.raises(TaskError):
        party.evaluate(1)
    party.workers.forgive()
    assert party.evaluate(2).answered.all()
