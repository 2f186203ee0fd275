"""What is said beside planning: events, health, an operator's commands, and a campaign's trials.

Fields are declared as in `messages`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np

from sumo_dist.episode.command import Command, Verb
from sumo_dist.wire.keys import NAME_PATTERN
from sumo_dist.wire.messages import Count, Message, Name
from sumo_dist.wire.schema import Array, Lines, Settings, Text

POOL_HEALTH = 256  # workers that one message tells of
STATE = 200  # characters of what is said of one


@dataclass(frozen=True, eq=False)
class Event(Message):
    """Anybody -> tracer: something that a person should read.

    Attributes:
        source: id of the service that speaks.
        level: how bad it is.
        text: one line.
    """

    topic: ClassVar[str] = "events"
    sent_by: ClassVar[tuple[str, ...]] = ("robot", "optimizer")
    heard_by: ClassVar[tuple[str, ...]] = ("operator", "tracer")
    addressed_by: ClassVar[str | None] = "source"
    background: ClassVar[bool] = True
    any_run: ClassVar[bool] = True
    source: Name
    level: Literal["info", "warning", "error"]
    text: str


@dataclass(frozen=True, eq=False)
class TrialRequest(Message):
    """Campaign -> a trial worker: one whole episode.

    Attributes:
        worker: who is asked.
        number: of the question, counted over the campaign's run.
        variant: of the trial: planned, or standing.
        episode: the EpisodeConfig, as JSON.
    """

    topic: ClassVar[str] = "trial"
    sent_by: ClassVar[tuple[str, ...]] = ("operator",)
    heard_by: ClassVar[tuple[str, ...]] = ("worker",)
    addressed_by: ClassVar[str | None] = "worker"
    ordered_by: ClassVar[tuple[str, ...]] = ("number",)
    worker: Name
    number: Count
    variant: Name
    episode: Annotated[str, Text(longest=20_000)]


@dataclass(frozen=True, eq=False)
class TrialReply(Message):
    """A trial worker -> campaign: how the episode ended.

    Attributes:
        worker, number: of the request.
        row: of the journal, JSON; "" if there is none.
        refusal: why there is none.
    """

    topic: ClassVar[str] = "trial-result"
    sent_by: ClassVar[tuple[str, ...]] = ("worker",)
    heard_by: ClassVar[tuple[str, ...]] = ("operator",)
    addressed_by: ClassVar[str | None] = "worker"
    ordered_by: ClassVar[tuple[str, ...]] = ("number",)
    worker: Name
    number: Count
    row: Annotated[str, Text(longest=60_000)]
    refusal: str


@dataclass(frozen=True, eq=False)
class CommandMessage(Message):
    """An operator -> robot: what it is told while it works; see `Command`. Heard whatever the run.

    Attributes:
        number, sender, verb, name, value: of the command.
    """

    topic: ClassVar[str] = "command"
    sent_by: ClassVar[tuple[str, ...]] = ("operator",)
    heard_by: ClassVar[tuple[str, ...]] = ("robot",)
    any_run: ClassVar[bool] = True
    number: Count
    sender: Name
    verb: Verb
    name: Annotated[str, Text(longest=500)]
    value: Annotated[str, Text(longest=500)]

    @property
    def command(self) -> Command:
        """The command."""
        return Command(self.number, self.sender, self.verb, self.name, self.value)


@dataclass(frozen=True, eq=False)
class Ack(Message):
    """robot -> an operator: a command was carried out, or why not. Heard whatever the run.

    Attributes:
        number, sender: of the command.
        tick: at which it was carried out or refused.
        refusal: why it was not; "" if it was.
    """

    topic: ClassVar[str] = "ack"
    sent_by: ClassVar[tuple[str, ...]] = ("robot",)
    heard_by: ClassVar[tuple[str, ...]] = ("operator", "tracer")
    addressed_by: ClassVar[str | None] = "sender"
    any_run: ClassVar[bool] = True
    number: Count
    sender: Name
    tick: Count
    refusal: Annotated[str, Text(longest=1000)]


@dataclass(frozen=True, eq=False)
class Drain(Message):
    """An operator -> one worker: finish what it was asked, then end.

    Attributes:
        worker: who is told.
        sender: who tells it.
    """

    topic: ClassVar[str] = "drain"
    sent_by: ClassVar[tuple[str, ...]] = ("operator",)
    heard_by: ClassVar[tuple[str, ...]] = ("worker",)
    addressed_by: ClassVar[str | None] = "worker"
    any_run: ClassVar[bool] = True
    pooled: ClassVar[bool] = True
    worker: Name
    sender: Name


class WorkerStatus(NamedTuple):
    """How one worker is.

    Attributes:
        worker: its name.
        state: "answers", or why it is not asked; cut where it is too long.
        rollouts_per_s: that can be counted on.
        lost: rollouts it was asked for and did not answer in time.
        silent_s: since its last answer [s]; -1 if there was none.
    """

    worker: str
    state: str
    rollouts_per_s: float
    lost: int
    silent_s: float


@dataclass(frozen=True, eq=False)
class WorkerHealth(Message):
    """optimizer -> whoever watches: up to POOL_HEALTH of its workers, a few times a second.

    Attributes:
        source: id of the optimizer.
        workers, states: (W,) texts; see WorkerStatus for these and the others.
        rollouts_per_s, lost, silent_s: (W,).
    """

    topic: ClassVar[str] = "worker-health"
    sent_by: ClassVar[tuple[str, ...]] = ("optimizer",)
    heard_by: ClassVar[tuple[str, ...]] = ("operator", "tracer")
    addressed_by: ClassVar[str | None] = "source"
    background: ClassVar[bool] = True
    any_run: ClassVar[bool] = True
    source: Name
    workers: Annotated[tuple[str, ...], Lines("W", NAME_PATTERN)]
    states: Annotated[tuple[str, ...], Lines("W", longest=STATE)]
    rollouts_per_s: Annotated[np.ndarray, Array("f8", "W")]
    lost: Annotated[np.ndarray, Array("i8", "W")]
    silent_s: Annotated[np.ndarray, Array("f8", "W")]

    @classmethod
    def of(cls, run: str, source: str, told: Sequence[WorkerStatus]) -> "WorkerHealth":
        """Put workers on the wire, at least one."""
        states = tuple(" ".join(status.state.split())[:STATE] for status in told)
        return cls(
            run,
            source,
            tuple(status.worker for status in told),
            states,
            np.array([status.rollouts_per_s for status in told]),
            np.array([status.lost for status in told], np.int64),
            np.array([status.silent_s for status in told]),
        )

    @property
    def told(self) -> list[WorkerStatus]:
        """Each worker."""
        numbers = self.rollouts_per_s.tolist(), self.lost.tolist(), self.silent_s.tolist()
        return [
            WorkerStatus(*all_) for all_ in zip(self.workers, self.states, *numbers, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Health(Message):
    """Every service -> whoever watches: how it is, a few times a second.

    Attributes:
        source: id of the service.
        mode: one word for what it does; of the robot "running", "stopping", "stopped", "rising".
        counters: by name: what it has done, dropped and refused so far.
    """

    topic: ClassVar[str] = "health"
    sent_by: ClassVar[tuple[str, ...]] = ("robot", "optimizer", "worker")
    heard_by: ClassVar[tuple[str, ...]] = ("operator", "tracer")
    addressed_by: ClassVar[str | None] = "source"
    background: ClassVar[bool] = True
    any_run: ClassVar[bool] = True
    of_all: ClassVar[bool] = True
    source: Name
    mode: Annotated[str, Text(longest=40)]
    counters: Annotated[dict[str, int | float | str], Settings()]
