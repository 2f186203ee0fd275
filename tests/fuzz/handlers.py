"""The services' message handlers without a network, for the fuzz tests to call.

The handlers of robot, optimizer, estimator and worker are the real ones, up to where rollouts would
start. Only the session is a stand-in: it keeps the callbacks that are declared on it, so that bytes
reach them faster than over a network.
"""

import queue
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from sumo_dist.dispatch.evaluator import STRIKES, RemoteEvaluator
from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.follow import Follower, misfit
from sumo_dist.episode.safety import StateWatch
from sumo_dist.errors import SumoError
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.report import PlanReport
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.services.estimator import Desk
from sumo_dist.services.optimizer import Feed
from sumo_dist.services.worker import Inbox
from sumo_dist.tasks import load_task
from sumo_dist.wire import bus as bus_module
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.codec import decode, encode, seal, unseal
from sumo_dist.wire.keys import SCHEMA, Member, alive_key
from sumo_dist.wire.messages import (
    Event,
    Health,
    Message,
    Order,
    PlanMessage,
    RolloutReply,
    RolloutRequest,
    RunEnd,
    Sensors,
    State,
    Status,
    Traces,
)

RUN, ROBOT, WORKER = "run", "spot", "w-1"
TERMS = len(load_task("spot/move_box").cost)


class _Sample:
    """What a callback gets."""

    def __init__(self, key: str, payload: bytes, kind: Any = None) -> None:
        self.key_expr, self.payload, self.kind = key, self, kind
        self._bytes = payload

    def to_bytes(self) -> bytes:
        return self._bytes


class _Session:
    """Keeps what is declared on it; what is published calls `on_put`."""

    def __init__(self) -> None:
        self.callbacks: list[tuple[str, Callable[[Any], None]]] = []
        self.on_put: Callable[[], None] = lambda: None

    def declare_subscriber(self, key: str, callback: Callable[[Any], None], **_: Any) -> None:
        self.callbacks.append((key, callback))

    def declare_publisher(self, *_: Any, **__: Any) -> "_Session":
        return self

    def liveliness(self) -> "_Session":
        return self

    def put(self, _payload: bytes) -> None:
        self.on_put()


class MessageHandlers:
    """The message handlers of robot, optimizer, worker and estimator in one process.

    Attributes:
        outcomes: inputs by what became of them: "accepted", or the reason of their rejection.
        handled: what some input has got as far as.
    """

    def __init__(self) -> None:
        """Set up the services of a run of spot/move_box."""
        self.outcomes: Counter[str] = Counter()
        self.handled: set[str] = set()
        self._kinds = sorted(Message.__subclasses__(), key=lambda kind: kind.__name__)
        self._session = _Session()
        self.bus = Bus(self._session, ROBOT, RUN)  # pyright: ignore[reportArgumentType]
        config = EpisodeConfig("spot/move_box", planner=PlannerConfig(rollouts=8))
        task = load_task(config.task)
        model = compile_model(task.scene, PLANT)
        self._actions, self._nq, size = task.actions, model.nq, model.nq + model.nv
        self._watch = StateWatch(task.scene.robot, model.nq)
        self._guard = CommandGuard(task.scene.robot, model, lambda _targets: None, 0.02)
        self._link = RobotLink(
            *(self.bus, RUN, 1.0, threading.Event(), lambda *_: None, lambda _: None),
            lambda plan: misfit(plan, self._actions, 100),
            size,
        )
        self._feed = Feed(self.bus)
        self._desks = [Desk(kind, model) for kind in ("truth", "lowpass")]
        self._sensors: queue.SimpleQueue[Sensors] = self.bus.inbox(Sensors)
        self._requests = Inbox()
        self.bus.subscribe(RolloutRequest, self._requests.put)
        self._gather(config, Problem.build(task, planning_options(config.planner)))

    def _gather(self, config: EpisodeConfig, problem: Problem) -> None:
        """Let a worker join the optimizer, which has eight candidates rolled out by it."""
        stop = threading.Event()
        self._evaluator = RemoteEvaluator(
            self.bus, RUN, problem, config.planner, "-", stop, lambda *_: None
        )
        state = np.zeros(problem.model.nq + problem.model.nv)
        self._request = PlanRequest(4, 10, state, np.zeros(12, np.float32), None)
        self._knots = np.zeros((8, config.planner.nodes, self._actions.size), np.float32)
        self._join()

    def _join(self) -> None:
        key = alive_key(ROBOT, Member("worker", WORKER, SCHEMA, "-"))
        for declared, callback in self._session.callbacks:
            if declared.startswith("sumo/alive/"):
                callback(_Sample(key, b"", zenoh_kind()))

    def seed(self, message: Message) -> bytes:
        """Return the input that stands for a message: its kind, then its packed bytes."""
        return bytes([self._kinds.index(type(message))]) + unseal(encode(message))

    def feed(self, data: bytes) -> None:
        """Give bytes to the handlers of one topic, sealed, so that they get past the checksum."""
        if not data:
            return
        kind = self._kinds[data[0] % len(self._kinds)]
        payload = seal(data[1:])
        self.check(kind, payload)
        self.deliver(kind, payload)

    def check(self, kind: type[Message], payload: bytes) -> None:
        """Decode; what is accepted must come out again as it went in."""
        try:
            message = decode(kind, payload)
        except SumoError as error:
            self.outcomes[getattr(error, "reason", "other")] += 1
            return
        self.outcomes["accepted"] += 1
        again = encode(message)
        assert encode(decode(kind, again)) == again

    def deliver(self, kind: type[Message], payload: bytes) -> None:
        """Hand a payload to everybody who listens to its topic, and let them work on it."""

        def give() -> None:
            self._session.on_put = lambda: None
            for key, callback in self._session.callbacks:
                if f"/{kind.topic}" in key:
                    callback(_Sample(key, payload))

        if kind is RolloutReply:  # it comes while the optimizer waits for it
            for _ in range(STRIKES):  # what is refused once may have been spoilt
                self._session.on_put = give
                self._plan()
        else:
            give()
            self._robot()
            self._others()

    def _plan(self) -> None:
        """Ask the worker, which has answered before the deadline or not."""
        vars(self._evaluator)["_shards_sent"] = 0  # an input means the same whenever it comes
        self._evaluator.reset_account(deadline=0.0)
        evaluation = self._evaluator(self._request, 0, self._knots)
        counted = evaluation.terms[evaluation.answered & evaluation.valid]
        assert np.isfinite(counted).all()
        if evaluation.answered.any():
            self.handled.add("reply")
        if not self._evaluator.workers:  # left out for good, as it should be: hire it again
            self.handled.add("refusal")
            self._join()

    def _robot(self) -> None:
        """What the robot does with its newest plans and state."""
        follower = Follower(self._actions)
        for report in self._link.new_plans():
            follower.offer(report.plan)
            self.handled.add("plan")
        action = follower.action(100)
        assert np.isfinite(action).all()
        newest = self._link.newest_state(0, 0.0)
        if newest is not None and self._watch.trip(newest[0], newest) is None:
            self.handled.add("state")
            self._guard.send(newest[1][7:26])  # as if the policy had made them of the state
        assert np.isfinite(self._guard.last).all()
        self._link.stop_order()
        self._link.resume_order()

    def _others(self) -> None:
        """What estimator, optimizer and worker do."""
        while not self._sensors.empty():
            sensors = self._sensors.get()
            for desk in self._desks:
                state = desk.answer(sensors)
                if state is not None:
                    self.handled.add("estimate")
                    encode(state)  # raises if it is not finite
        pair = self._feed.wait(lambda _status: True, timeout=0.0)
        if pair is not None and pair[1].followed is not None:
            self.handled.add("status")
            misfit(pair[1].followed, self._actions)
        if self._requests.get(timeout=0.0) is not None:
            self.handled.add("request")


def samples(rng: np.random.Generator) -> list[Message]:
    """Return valid messages of every kind, as the services of this target would send them."""
    none, knots = np.zeros(0, np.int64), rng.uniform(-1, 1, (4, 9)).astype(np.float32)
    plan = Plan(41, 102, knots, 1.5, "linear")
    memory, state = np.zeros(12, np.float32), np.concatenate([[0, 0, 0.5, 1], rng.random(60)])
    poses = np.tile([0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], (1, 2, 1))
    settings = asdict(PlannerConfig(rollouts=8))
    ok, costs = np.ones(8, bool), rng.random((8, 6))
    return [
        Sensors(RUN, 3, state, none, np.zeros((0, 38)), none, np.zeros((0, 2, 7))),
        Sensors(RUN, 4, none.astype(float), none + 0, np.zeros((0, 38)), np.array([75]), poses),
        Sensors(RUN, 5, none.astype(float), np.array([99]), rng.random((1, 38)), none, poses[:0]),
        State(RUN, 0, state),
        Status(RUN, 0, memory, 1, "lockstep", 1.0, plan),
        PlanMessage.of(RUN, PlanReport(plan, costs[:, 0], ok, costs[0], 30.0, 2.0)),
        RolloutRequest(
            *(RUN, WORKER, 4, 0, 1, 0, "spot/move_box", "ab12", "-", settings),
            *(state, memory, np.zeros((8, 4, 9), np.float32), 40.0),
        ),
        RolloutReply(RUN, WORKER, 4, 0, 1, 0, rng.random((8, TERMS)), ok, 30.0, ""),
        RolloutReply(RUN, WORKER, 4, 0, 1, 0, np.zeros((0, 0)), ok[:0], 0.0, "other task"),
        Traces(RUN, WORKER, 4, 0, 0, rng.random((2, 2, 25, 3)).astype(np.float32)),
        Event(RUN, "optimizer", "warning", "no workers"),
        RunEnd(RUN, 700, "success", success=True),
        Order(RUN, "somebody", "stop", "smoke"),
        Health(RUN, "robot", "running", {"tick": 7, "load": 0.5}),
    ]


def zenoh_kind() -> Any:
    """Kind of a liveliness sample of a member that is there."""
    return bus_module.zenoh.SampleKind.PUT
