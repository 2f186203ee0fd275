"""The services' message handlers without a network, for the fuzz tests to call.

The handlers of robot, optimizer, estimator and worker are the real ones, up to where rollouts would
start. Only the session is a stand-in: it keeps the callbacks that are declared on it, so that bytes
reach them faster than over a network.
"""

import json
import queue
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np

from sumo_dist.control.picture import SHOWN, Picture
from sumo_dist.dispatch.evaluator import RemoteEvaluator
from sumo_dist.dispatch.questions import QuestionSlot
from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.dispatch.workers import REFUSALS_TO_LEAVE_OUT
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Controls
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.follow import Follower
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.safety import StateWatch
from sumo_dist.errors import SumoError, TaskError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.services.estimator import EstimatorServer
from sumo_dist.services.inbox import Inbox
from sumo_dist.services.optimizer import OptimizerOptions, OptimizerServer
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK, anchor_tick
from sumo_dist.wire import bus as bus_module
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.codec import decode, encode, seal, unseal
from sumo_dist.wire.keys import POOL, SCHEMA, Member, alive_key
from sumo_dist.wire.messages import (
    EpisodeEnd,
    EpisodeInfo,
    Message,
    NoPlan,
    PlanMessage,
    Question,
    RolloutReply,
    RolloutRequest,
    Sensors,
    State,
    Traces,
)
from sumo_dist.wire.notices import (
    Ack,
    CommandMessage,
    Drain,
    Event,
    Health,
    TrialReply,
    TrialRequest,
    WorkerHealth,
    WorkerStatus,
)

RUN, ROBOT, WORKER, ASKER = "run", "spot", "w-1", "o-1"
NOW = 100  # the robot's tick
CONFIG = EpisodeConfig("spot/move_box", planner=PlannerConfig(rollouts=8))
COST = load_task(CONFIG.task).table.defaults
TERMS = len(COST.weights)


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
        self.on_put: Callable[[str, bytes], None] = lambda _key, _payload: None

    def declare_subscriber(self, key: str, callback: Callable[[Any], None], **_: Any) -> None:
        self.callbacks.append((key, callback))

    def declare_publisher(self, key: str, **_: Any) -> "_Publisher":
        return _Publisher(self, key)

    def liveliness(self) -> "_Session":
        return self

    def give(self, topic: str, payload: bytes) -> None:
        """Hand a payload to everybody who listens to a topic."""
        for key, callback in self.callbacks:
            if topic in key.split("/")[3:4]:
                callback(_Sample(key, payload))


class _Publisher:
    """Where messages of one key go."""

    def __init__(self, session: _Session, key: str) -> None:
        self._session, self._topic = session, key.split("/")[3]

    def put(self, payload: bytes) -> None:
        self._session.on_put(self._topic, payload)


class _NoRollouts(RemoteEvaluator):
    """Evaluates without workers: all candidates cost the same."""

    def __call__(self, request: PlanRequest, iteration: int, knots: np.ndarray) -> Evaluation:
        del iteration
        all_of_them, terms = np.ones(len(knots), bool), np.ones((len(knots), TERMS))
        assert len(request.cost.weights) == TERMS
        return Evaluation(terms, all_of_them, all_of_them, np.empty(0, np.float32))


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
        self._episode = Episode.assemble(CONFIG)
        self._start_estimators()
        self._start_optimizer()
        self._gather()
        self._requests = Inbox()
        self._bus().subscribe(RolloutRequest, self._requests.put)
        self._open_page()
        self._start_robot()

    def _open_page(self) -> None:
        self._picture, bus = Picture(ROBOT), self._bus()
        for kind in SHOWN:
            bus.subscribe(kind, self._picture.take)

    def _bus(self, run: str | None = None, session: _Session | None = None) -> Bus:
        return Bus(session or self._session, ROBOT, run)  # pyright: ignore[reportArgumentType]

    def _start_robot(self) -> None:
        """Let a robot begin its episode, which the others take up."""
        task, model = self._episode.task, self._episode.problem.model
        self._watch = StateWatch(task.scene.robot, model.nq)
        self._guard = CommandGuard(task.scene.robot, model, lambda _targets: None, TICK)
        on_plan = Progress(task.table.terms, lambda _line: None)
        self._link = RobotLink(self._bus(RUN), 1.0, threading.Event(), _tell, on_plan)
        self._session.on_put = self._published
        self._info = EpisodeInfo(RUN, CONFIG.to_json(), self._episode.problem.hash, 1)
        self._link.enter(self._episode, self._info)
        self._sense()
        self._others()

    def _start_estimators(self) -> None:
        self._estimators = {kind: EstimatorServer() for kind in ("truth", "lowpass")}
        self._heard: queue.SimpleQueue[EpisodeInfo | Sensors] = queue.SimpleQueue()
        bus = self._bus()
        bus.subscribe(EpisodeInfo, self._heard.put)
        bus.subscribe(Sensors, self._heard.put)

    def _start_optimizer(self) -> None:
        bus, stop, alone = self._bus(), threading.Event(), self._bus(session=_Session())
        self._slot = QuestionSlot(bus)
        evaluator = _NoRollouts(alone, ASKER, "-", stop, _tell)
        self._optimizer = OptimizerServer(OptimizerOptions(), bus, evaluator, _tell)

    def _gather(self) -> None:
        """Let a worker join an optimizer, which has eight candidates rolled out by it."""
        self._evaluator = RemoteEvaluator(self._bus(RUN), ASKER, "-", threading.Event(), _tell)
        state, memory = np.array(self._episode.body.truth), np.zeros(12, np.float32)
        self._request = PlanRequest(4, 10, state, memory, None, COST)
        self._knots = np.zeros((8, CONFIG.planner.nodes, 9), np.float32)
        self._join()

    def _join(self) -> None:
        """Let the worker join, as if for the first time."""
        key = alive_key(POOL, Member("worker", WORKER, SCHEMA, "-"))
        for declared, callback in self._session.callbacks:
            if declared.startswith("sumo/alive/"):
                callback(_Sample(key, b"", bus_module.zenoh.SampleKind.DELETE))
                callback(_Sample(key, b"", bus_module.zenoh.SampleKind.PUT))

    def _published(self, topic: str, payload: bytes) -> None:
        """Take note; what the robot says of its episode reaches the others."""
        self.handled.add(f"published {topic}")
        if topic == EpisodeInfo.topic:
            self._session.give(topic, payload)

    def seed(self, message: Message) -> bytes:
        """Return the input that stands for a message: its kind, then its packed bytes."""
        return bytes([self._kinds.index(type(message))]) + unseal(encode(message))

    def feed(self, data: bytes) -> None:
        """Give bytes to the handlers of one topic, sealed, so that they get past the checksum."""
        if not data:
            return
        kind = self._kinds[data[0] % len(self._kinds)]
        payload = seal(data[1:])
        accepted = self.outcomes["accepted"]
        self.check(kind, payload)
        self.deliver(kind, payload)
        if kind in SHOWN and self.outcomes["accepted"] > accepted:
            json.dumps(self._picture.snapshot(), allow_nan=False)  # which no browser could read

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
        give = partial(self._session.give, kind.topic, payload)
        if kind is RolloutReply:  # it comes while the optimizer waits for it
            for _ in range(REFUSALS_TO_LEAVE_OUT):  # what is refused once may have been spoilt
                self._session.on_put = lambda _topic, _payload: self._answer(give)
                self._plan()
                self._session.on_put = self._published
        else:
            give()
            self._others()
            self._robot()

    def _answer(self, give: Callable[[], None]) -> None:
        self._session.on_put = lambda _topic, _payload: None
        give()

    def _plan(self) -> None:
        """Ask the worker, which has answered before the deadline or not."""
        self._evaluator._shard = 0  # an input means the same whenever it comes
        if (worker := self._evaluator.workers.get(WORKER)) is not None:
            worker.speed, worker.timely = 1e6, 1.0  # all rows are in one request
        self._evaluator.begin(self._episode.problem, CONFIG.planner, deadline=0.0)
        try:
            evaluation = self._evaluator(self._request, 0, self._knots)
        except TaskError:  # the only worker there is blames the task
            self.handled.add("blamed task")
            self._join()
            return
        counted = evaluation.terms[evaluation.answered & evaluation.valid]
        assert np.isfinite(counted).all()
        assert not np.isnan(evaluation.costs(COST.weights)).any()
        if evaluation.answered.any():
            self.handled.add("reply")
        if not self._evaluator.workers:  # left out for good, as it should be: hire it again
            self.handled.add("refusal")
            self._join()
        self._evaluator.workers.publish_health(self._evaluator._bus, ASKER)

    def _robot(self) -> None:
        """What the robot does with its newest plans, commands and state."""
        follower = Follower(self._episode.task.actions)
        for report in self._new_plans():
            follower.offer(report.plan)
            Recording(self._episode.recording.config).add_plan(report)
            self.handled.add("plan")
        action = follower.action(NOW)
        assert np.isfinite(action).all()
        newest = self._link.newest_state(0, 0.0)
        if newest is not None and self._watch.trip(newest[0], newest) is None:
            self.handled.add("state")
            self._guard.send(newest[1][7:26])  # as if the policy had made them of the state
        assert np.isfinite(self._guard.last).all()
        self._obey()
        self._sense()

    def _new_plans(self) -> list[PlanReport]:
        """Return the robot's newest plans; told that none will come, it begins again."""
        try:
            return self._link.new_plans()
        except TaskError:
            self.handled.add("no plan")
            self._link.enter(self._episode, self._info)
            return []

    def _obey(self) -> None:
        """What the robot does with commands, and what it asks after them."""
        episode, operator = self._episode, self._link.operator
        for command in operator.take(NOW, 0.0):
            refusal = episode.controls.apply(command, NOW)
            operator.answer(command, NOW, refusal)
            if not refusal:
                self.handled.add(f"command {command.verb}")
        state = self._request.state
        request = episode.request(-1, NOW, state, self._request.memory, None)
        self._link.send_question(request, episode.controls.planner, 1.0)
        episode.controls = Controls(CONFIG, episode.task)

    def _sense(self) -> None:
        """Say what the sensors see, and put right what others tell of the episode."""
        nothing = np.zeros(0, np.int64)
        readings = Readings(
            *(NOW, self._request.state, nothing, np.zeros((0, 38))),
            *(nothing, np.zeros((0, 2, 7))),
        )
        self._link.send_readings(readings)

    def _others(self) -> None:
        """What estimator, optimizer and worker do."""
        while not self._heard.empty():
            self._estimate(self._heard.get())
        info, question = self._slot.wait(timeout=0.0)
        try:
            if info is not None:
                self._optimizer.enter(info)
                self.handled.add("episode")
            if question is not None:
                self._optimizer.handle(question, self._slot.arrived)
        except SumoError as error:
            self._optimizer.refuse(str(error))
            self.handled.add("refused question")
        if self._requests.get(timeout=0.0) is not None:
            self.handled.add("request")

    def _estimate(self, message: EpisodeInfo | Sensors) -> None:
        for kind, estimator in self._estimators.items():
            given = message
            if isinstance(given, EpisodeInfo):
                given = replace(given, config=given.config.replace("truth", kind))
            state = estimator.answer(given)
            if state is not None:
                self.handled.add(f"{kind} estimate")
                encode(state)  # raises if it is not finite


def _tell(level: str, text: str) -> None:
    """Tell nobody."""


def samples(rng: np.random.Generator) -> list[Message]:
    """Return valid messages of every kind, as the services of this target would send them."""
    none, knots = (
        np.zeros(0, np.int64),
        rng.uniform(-1, 1, (CONFIG.planner.nodes, 9)).astype(np.float32),
    )
    plan = Plan(40, anchor_tick(40), knots, 1.5, "linear")
    memory, state = np.zeros(12, np.float32), np.concatenate([[0, 0, 0.5, 1], rng.random(60)])
    poses = np.tile([0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], (1, 2, 1))
    settings, hash_ = asdict(CONFIG.planner), Episode.assemble(CONFIG).problem.hash
    ok, costs = np.ones(8, bool), rng.random((8, TERMS))
    cost = COST.weights, COST.parameters
    commands = (
        *(("weight", "goal", "80"), ("parameter", "goal", "1,0"), ("planner", "rollouts", "9")),
        *(("pause", "", ""), ("reset", "", "7"), ("task", "spot/move_cone", ""), ("stop", "", "x")),
    )
    refused = RUN, WORKER, ASKER, 4, 0, 1, 0, np.zeros((0, 0)), ok[:0], 0.0
    return [
        EpisodeInfo(RUN, CONFIG.to_json(), hash_, 1),
        EpisodeInfo("other", replace(CONFIG, seed=2).to_json(), hash_, 2),
        Sensors(RUN, 3, state, none, np.zeros((0, 38)), none, np.zeros((0, 2, 7))),
        Sensors(RUN, 4, none.astype(float), none + 0, np.zeros((0, 38)), np.array([75]), poses),
        Sensors(RUN, 5, none.astype(float), np.array([99]), rng.random((1, 38)), none, poses[:0]),
        State(RUN, 0, state),
        Question(RUN, 1, 2, "lockstep", 1.0, state, memory, None, *cost, settings),
        Question(RUN, -1, 103, "realtime", 0.5, state, memory, plan, *cost, settings),
        Question(RUN, -1, 104, "realtime", 0.5, state, memory, plan, *cost, settings),
        PlanMessage.of(RUN, PlanReport(plan, costs[:, 0], ok, costs[0], *cost, 30.0, 2.0)),
        NoPlan(RUN, "cost term 'mine': mine.py, line 3: ZeroDivisionError"),
        RolloutRequest(
            *(RUN, WORKER, ASKER, ROBOT, 4, 0, 1, 0, CONFIG.task, "ab12", "-", settings),
            *(state, memory, COST.parameters, np.zeros((8, 4, 9), np.float32), 40.0),
        ),
        RolloutReply(RUN, WORKER, ASKER, 4, 0, 1, 0, costs, ok, 30.0, "", False),
        RolloutReply(*refused, "other task", False),
        RolloutReply(*refused, "mine.py, 3", True),
        Traces(RUN, WORKER, ROBOT, 4, 0, 0, rng.random((2, 2, 25, 3)).astype(np.float32)),
        Event(RUN, "optimizer", "warning", "no workers"),
        EpisodeEnd(RUN, 700, "success", success=True, last=True),
        *(CommandMessage(RUN, n, "somebody", *command) for n, command in enumerate(commands)),
        Ack(RUN, 3, "somebody", 12, "unknown task"),
        Drain("", WORKER, "somebody"),
        Health(RUN, "robot", "running", {"tick": 7, "load": 0.5}),
        WorkerHealth.of(RUN, ASKER, [WorkerStatus(WORKER, "answers", 800.0, 3, 0.5)]),
        TrialRequest(RUN, "w-1.0", 3, "planned", CONFIG.to_json()),
        TrialReply(RUN, "w-1.0", 3, '{"task": "spot/move_box", "seed": 1}', ""),
    ]
