"""What the services say to each other. Every field's dtype, shape and range is part of its type.

Sizes: B rollouts of a plan, b of a shard, K knots, n searched action dimensions, nm policy memory.
Floats are finite: costs that are not travel as zeros beside a mask.
"""

from dataclasses import dataclass, fields
from typing import Annotated, ClassVar, Literal

import numpy as np

from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.wire.keys import NAME_PATTERN, PRIORITIES
from sumo_dist.wire.schema import MAX_BYTES, Array, Fields, Float, Int, Settings, Text

Count = Annotated[int, Int(0, 2**53)]
Milliseconds = Annotated[float, Float(0.0)]
Speed = Annotated[float, Float(0.0, 100.0)]
Priority = Annotated[int, Int(-PRIORITIES, PRIORITIES)]
Name = Annotated[str, Text(NAME_PATTERN)]

WirePlan = Annotated[
    Plan,
    Fields(
        number=Int(0, 2**53),
        tick=Int(0, 2**53),
        knots=Array("f4", "K", "n"),
        horizon=Float(1e-3, 100.0),
    ),
]


@dataclass(frozen=True, eq=False)
class Message:
    """What all messages have.

    Attributes:
        run: id of the run it belongs to.
    """

    topic: ClassVar[str]
    addressed_by: ClassVar[str | None] = None  # field with the service that the key names, if any
    ordered_by: ClassVar[tuple[str, ...]] = ()
    background: ClassVar[bool] = False  # only watched: gives way to what the plan waits for
    any_run: ClassVar[bool] = False  # heard in every run, whatever its id
    pooled: ClassVar[bool] = False  # to or from a worker, which serves any robot
    of_all: ClassVar[bool] = False  # workers speak so, too: who listens to a robot hears them
    sent_by: ClassVar[tuple[str, ...]] = ()  # roles that may send it, see `wire.access`
    heard_by: ClassVar[tuple[str, ...]] = ()
    most_bytes: ClassVar[int] = 128 << 10  # a router lets no longer one through
    run: Annotated[str, Text(longest=200)]

    @property
    def address(self) -> str | None:
        """The service that the message is to or from, where its topic has a key per service."""
        return None if self.addressed_by is None else getattr(self, self.addressed_by)

    @property
    def order(self) -> tuple[int, ...]:
        """Grows within a run: what compares less than a message already seen is stale."""
        return tuple(getattr(self, name) for name in self.ordered_by)


@dataclass(frozen=True, eq=False)
class EpisodeInfo(Message):
    """robot -> all: the episode that it is in, which they take up. Heard whatever the run.

    Attributes:
        config: the EpisodeConfig, as JSON.
        task_hash: of the task that the robot has loaded.
        number: of the episode within the robot's session, from 1 on.
    """

    topic: ClassVar[str] = "episode"
    sent_by: ClassVar[tuple[str, ...]] = ("robot",)
    heard_by: ClassVar[tuple[str, ...]] = ("robot", "optimizer", "operator", "tracer")
    any_run: ClassVar[bool] = True
    config: Annotated[str, Text(longest=20_000)]
    task_hash: Annotated[str, Text(longest=64)]
    number: Count


@dataclass(frozen=True, eq=False)
class Sensors(Message):
    """robot -> estimator: what the sensors saw up to a tick.

    Attributes:
        tick: policy tick.
        truth: the plant's state, (nq + nv,); empty where the robot sends packets.
        encoder_ms, encoders: stamps [ms] and joint positions and velocities, (E, 2 nj).
        mocap_ms, mocap: stamps [ms] and poses, (M, bodies, 7): position [m], quaternion wxyz.
    """

    topic: ClassVar[str] = "sensors"
    sent_by: ClassVar[tuple[str, ...]] = ("robot",)
    heard_by: ClassVar[tuple[str, ...]] = ("robot",)
    any_run: ClassVar[bool] = True  # the estimator may not have heard of the episode yet
    ordered_by: ClassVar[tuple[str, ...]] = ("tick",)
    tick: Count
    truth: Annotated[np.ndarray, Array("f8", "n", empty=True)]
    encoder_ms: Annotated[np.ndarray, Array("i8", "E", empty=True)]
    encoders: Annotated[np.ndarray, Array("f8", "E", "2nj", empty=True)]
    mocap_ms: Annotated[np.ndarray, Array("i8", "M", empty=True)]
    mocap: Annotated[np.ndarray, Array("f8", "M", "bodies", 7, empty=True)]


@dataclass(frozen=True, eq=False)
class State(Message):
    """estimator -> all: the estimated state before a tick's policy evaluation.

    Attributes:
        tick: policy tick.
        state: (nq + nv,) qpos then qvel.
    """

    topic: ClassVar[str] = "state"
    sent_by: ClassVar[tuple[str, ...]] = ("robot",)
    heard_by: ClassVar[tuple[str, ...]] = ("robot", "operator", "tracer")
    ordered_by: ClassVar[tuple[str, ...]] = ("tick",)
    tick: Count
    state: Annotated[np.ndarray, Array("f8", "n")]


@dataclass(frozen=True, eq=False)
class Question(Message):
    """robot -> optimizer, tracer: everything that a plan depends on.

    Attributes:
        number: of the plan that the robot waits for; -1 if it waits for none, in realtime.
        tick: policy tick of the state.
        clock: "lockstep", "realtime", or "calibrate" while the speed is being measured.
        speed: robot time per wall time that a realtime run asks for; 0 where it wants no plan.
        state: (nq + nv,) that the robot acts on at that tick.
        memory: (nm,) policy memory before that tick's evaluation.
        followed: the plan that is being followed, None at the start.
        weights: (n_terms,) of the cost.
        parameters: (n,) of the task.
        settings: fields of the PlannerConfig.
        heard: number of the newest plan that has come; -1 before the first.
        held_ms: wall time since it came [ms], so that the optimizer knows how long a plan and the
            question after it were on their way.
    """

    topic: ClassVar[str] = "question"
    sent_by: ClassVar[tuple[str, ...]] = ("robot",)
    heard_by: ClassVar[tuple[str, ...]] = ("optimizer", "operator", "tracer")
    any_run: ClassVar[bool] = True  # the optimizer may not have heard of the episode yet
    ordered_by: ClassVar[tuple[str, ...]] = ("tick",)
    number: Annotated[int, Int(-1, 2**53)]
    tick: Count
    clock: Literal["lockstep", "realtime", "calibrate"]
    speed: Speed
    state: Annotated[np.ndarray, Array("f8", "state")]
    memory: Annotated[np.ndarray, Array("f4", "nm", empty=True)]
    followed: WirePlan | None
    weights: Annotated[np.ndarray, Array("f8", "n_terms")]
    parameters: Annotated[np.ndarray, Array("f8", "n_parameters", empty=True)]
    settings: Annotated[dict[str, int | float | str], Settings()]
    heard: Annotated[int, Int(-1, 2**53)] = -1
    held_ms: Milliseconds = 0.0


@dataclass(frozen=True, eq=False)
class PlanMessage(Message):
    """optimizer -> robot, tracer: a plan and how it came about.

    Attributes:
        plan: the plan.
        costs, finite: (B,) candidates' total costs; where not finite (lost, diverged), cost 0.
        terms: (n_terms,) weighted costs of the unperturbed candidate.
        weights, parameters: that the plan was made with.
        plan_ms: wall time from the state's arrival to the plan [ms].
        own_ms: the optimizer's own part of it [ms].
        age_ticks: ticks of robot time between the plan's state and its arrival, as far as the
            optimizer knows the way.
        lost, reissued, invalid: rollouts never answered, asked for twice, and diverged.
        failed: no candidate was finite; the plan is the shifted previous one.
        workers: that were alive.
    """

    topic: ClassVar[str] = "plan"
    sent_by: ClassVar[tuple[str, ...]] = ("optimizer",)
    heard_by: ClassVar[tuple[str, ...]] = ("robot", "operator", "tracer")
    most_bytes: ClassVar[int] = MAX_BYTES
    plan: WirePlan
    costs: Annotated[np.ndarray, Array("f8", "B")]
    finite: Annotated[np.ndarray, Array("b1", "B")]
    terms: Annotated[np.ndarray, Array("f8", "n_terms")]
    weights: Annotated[np.ndarray, Array("f8", "n_terms")]
    parameters: Annotated[np.ndarray, Array("f8", "n_parameters", empty=True)]
    plan_ms: Milliseconds
    own_ms: Milliseconds
    age_ticks: Count
    lost: Count
    reissued: Count
    invalid: Count
    failed: bool
    workers: Count

    @classmethod
    def of(cls, run: str, report: PlanReport) -> "PlanMessage":
        """Put a planner's report on the wire."""
        return cls(run, **vars(report))

    @property
    def report(self) -> PlanReport:
        """The planner's report."""
        return PlanReport(**{f.name: getattr(self, f.name) for f in fields(PlanReport)})

    @property
    def order(self) -> tuple[int, ...]:
        """By plan number."""
        return (self.plan.number,)


@dataclass(frozen=True, eq=False)
class NoPlan(Message):
    """optimizer -> robot: there will be no plan, because the task's own code raises.

    Attributes:
        reason: one line.
    """

    topic: ClassVar[str] = "no-plan"
    sent_by: ClassVar[tuple[str, ...]] = ("optimizer",)
    heard_by: ClassVar[tuple[str, ...]] = ("robot",)
    reason: str


@dataclass(frozen=True, eq=False)
class RolloutRequest(Message):
    """optimizer -> one worker: everything that the costs of some rows depend on.

    Attributes:
        worker: who is asked.
        asker: who asks, unique to an optimizer's process.
        robot: whose plan it is for.
        number, iteration: of the plan, and of the optimizer within it.
        shard: index of this part of the candidates.
        start: the part's first row among them.
        task, task_hash, build: what must be rolled out, by which build of the engine.
        settings: fields of the PlannerConfig.
        state: (nq + nv,) the rollouts start from.
        memory: (nm,) policy memory of the same instant.
        parameters: (n,) of the task.
        knots: (b, K, n) normalised actions.
        reply_budget_ms: after which the reply is of no use [ms]; 0 for never.
        priority: of the robot among those that the worker serves; higher ones go first.
    """

    topic: ClassVar[str] = "request"
    sent_by: ClassVar[tuple[str, ...]] = ("optimizer",)
    heard_by: ClassVar[tuple[str, ...]] = ("worker",)
    most_bytes: ClassVar[int] = MAX_BYTES
    addressed_by: ClassVar[str | None] = "worker"
    ordered_by: ClassVar[tuple[str, ...]] = ("number", "iteration")
    pooled: ClassVar[bool] = True
    worker: Name
    asker: Name
    robot: Name
    number: Count
    iteration: Count
    shard: Count
    start: Count
    task: str
    task_hash: str
    build: str
    settings: Annotated[dict[str, int | float | str], Settings()]
    state: Annotated[np.ndarray, Array("f8", "state")]
    memory: Annotated[np.ndarray, Array("f4", "nm", empty=True)]
    parameters: Annotated[np.ndarray, Array("f8", "n_parameters", empty=True)]
    knots: Annotated[np.ndarray, Array("f4", "b", "K", "n")]
    reply_budget_ms: Milliseconds
    priority: Priority = 0

    def reply(
        self, terms: np.ndarray, valid: np.ndarray, compute_ms: float = 0.0, threads: int = 1
    ) -> "RolloutReply":
        """Return the worker's reply with costs; see RolloutReply."""
        return RolloutReply(
            run=self.run,
            worker=self.worker,
            asker=self.asker,
            number=self.number,
            iteration=self.iteration,
            shard=self.shard,
            start=self.start,
            terms=terms,
            valid=valid,
            compute_ms=compute_ms,
            refusal="",
            task_fails=False,
            threads=threads,
        )


@dataclass(frozen=True, eq=False)
class RolloutReply(Message):
    """A worker -> optimizer: the costs of a request's rows, or why it refuses.

    Attributes:
        worker, asker, number, iteration, shard, start: of the request.
        terms: (b, n_terms) reduced residuals, unweighted; rows that are not valid are zeros.
        valid: (b,) the rollout and its costs are finite.
        compute_ms: wall time of the rollouts [ms].
        refusal: why nothing was rolled out (terms and valid are empty); "" if it was.
        task_fails: it refuses because the task's own code raises.
        threads: that it rolls out with.
        leaving: it is about to, and answers what it was asked so far.
    """

    topic: ClassVar[str] = "reply"
    sent_by: ClassVar[tuple[str, ...]] = ("worker",)
    heard_by: ClassVar[tuple[str, ...]] = ("optimizer",)
    most_bytes: ClassVar[int] = MAX_BYTES
    addressed_by: ClassVar[str | None] = "asker"
    ordered_by: ClassVar[tuple[str, ...]] = ("number", "iteration")
    pooled: ClassVar[bool] = True
    worker: Name
    asker: Name
    number: Count
    iteration: Count
    shard: Count
    start: Count
    terms: Annotated[np.ndarray, Array("f8", "b", "n_terms", empty=True)]
    valid: Annotated[np.ndarray, Array("b1", "b", empty=True)]
    compute_ms: Milliseconds
    refusal: str
    task_fails: bool
    threads: Annotated[int, Int(1, 256)] = 1
    leaving: bool = False


@dataclass(frozen=True, eq=False)
class Traces(Message):
    """A worker -> tracer: thinned paths of a request's rollouts.

    Attributes:
        worker, robot, number, iteration, start: of the request.
        traces: (b, F, P, 3) positions of F frames at P instants, world [m]; zeros if diverged.
    """

    topic: ClassVar[str] = "traces"
    sent_by: ClassVar[tuple[str, ...]] = ("worker",)
    heard_by: ClassVar[tuple[str, ...]] = ("tracer",)
    most_bytes: ClassVar[int] = MAX_BYTES
    addressed_by: ClassVar[str | None] = "robot"
    ordered_by: ClassVar[tuple[str, ...]] = ("number", "iteration")
    background: ClassVar[bool] = True
    pooled: ClassVar[bool] = True
    worker: Name
    robot: Name
    number: Count
    iteration: Count
    start: Count
    traces: Annotated[np.ndarray, Array("f4", "b", "F", "P", 3)]


@dataclass(frozen=True, eq=False)
class EpisodeEnd(Message):
    """robot -> all: the episode is over.

    Attributes:
        tick: last policy tick.
        reason: "success", "timeout", "fell", ...
        success: the task was achieved.
        last: no other episode follows.
    """

    topic: ClassVar[str] = "end"
    sent_by: ClassVar[tuple[str, ...]] = ("robot",)
    heard_by: ClassVar[tuple[str, ...]] = ("operator", "tracer")
    tick: Count
    reason: str
    success: bool
    last: bool
