"""A service's connection: publish and receive typed messages, announce itself, watch the others.

Callbacks run on Zenoh's threads, one a subscription: they must return quickly, so the two styles of
consumption are a slot with the newest message (`newest`) and a queue (`inbox`).
"""

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from queue import SimpleQueue
from typing import Generic, Self, TypeVar

import zenoh

from sumo_dist.authority.folder import KeyFolder
from sumo_dist.errors import SumoError
from sumo_dist.wire.codec import decode, encode
from sumo_dist.wire.keys import (
    ANY,
    INSECURE,
    POOL,
    ROUTER,
    SCHEMA,
    WORKER,
    Member,
    alive_key,
    alive_keys,
    checked_robot,
    parse_alive,
    router_tokens,
    topic_key,
)
from sumo_dist.wire.messages import Message
from sumo_dist.wire.schema import WireError
from sumo_dist.wire.session import open_client

M = TypeVar("M", bound=Message)

LEAVING_S = 1.5  # a service that was killed or cut off is seen for as long as this
_REPORTED_S = 0.05  # those that are there are reported within milliseconds

INBOX_LIMIT = 1000  # messages a consumer may be behind before newer ones are dropped

_log = logging.getLogger(__name__)

SHOUT = "INSECURE: the router takes anybody without keys: who reaches it owns the robot"


class Newest(Generic[M]):
    """A slot that holds the newest message; older ones that arrive late do not replace it."""

    def __init__(self) -> None:
        """Start empty."""
        self._changed = threading.Condition()
        self._message: M | None = None
        self._seen = True

    def put(self, message: M) -> bool:
        """Hold a message instead of the one held, unless that is newer; return whether it did."""
        with self._changed:
            held = self._message
            if held is not None and held.run == message.run and message.order < held.order:
                return False
            self._message, self._seen = message, False
            self._changed.notify_all()
            return True

    def peek(self) -> M | None:
        """Return the newest message, seen or not; None before the first."""
        return self._message

    def wait(self, timeout: float | None = None) -> M | None:
        """Return the newest message that `wait` has not returned yet; None after `timeout` [s]."""
        with self._changed:
            if not self._changed.wait_for(lambda: not self._seen, timeout):
                return None
            self._seen = True
            return self._message


class Members:
    """The living services of a role, as far as this side of the network knows."""

    def __init__(self, on_change: Callable[[Member, bool], None] | None) -> None:
        """Start without any; `on_change` gets each member that joins (True) or leaves (False)."""
        self._on_change = on_change
        self._members: frozenset[Member] = frozenset()

    @property
    def now(self) -> frozenset[Member]:
        """Who is alive."""
        return self._members

    def vacant(self, rival: Callable[[Member], bool] = lambda _: True) -> bool:
        """Return whether there is no rival, or none any more in a moment.

        For who is about to announce itself under a name that one service only may have.
        """
        deadline = time.monotonic() + LEAVING_S
        time.sleep(_REPORTED_S)
        while any(map(rival, self._members)):
            if time.monotonic() > deadline:
                return False
            time.sleep(_REPORTED_S)
        return True

    def update(self, member: Member, alive: bool) -> None:
        """Take note of a member; what is known already changes nothing."""
        if (member in self._members) == alive:
            return
        self._members = self._members | {member} if alive else self._members - {member}
        if self._on_change is not None:
            self._on_change(member, alive)


class Bus:
    """One service's session on the bus of one robot, or of a pool of workers.

    Close it, or use it as a context manager.

    Attributes:
        robot: its name; POOL of a worker, which serves any.
        run: id of the run this service is in: messages of others are dropped; None accepts all.
        rejected: messages dropped, counted by reason: those of WireError, "run" (of another run),
            "stale" (older than the newest), "overflow" (the consumer is too slow).
    """

    def __init__(self, session: zenoh.Session, robot: str, run: str | None = None) -> None:
        """Use an open session, which the bus closes; see `dial`."""
        self.run = run
        self.rejected: Counter[str] = Counter()
        self.robot = robot
        self._session = session
        self._closed = False
        self._lock = threading.Lock()
        self._publishers: dict[tuple[type, str | None], zenoh.Publisher] = {}
        self._receivers: list[zenoh.Subscriber] = []
        self._tokens: list[zenoh.LivelinessToken] = []  # one that is collected is withdrawn

    @classmethod
    def dial(
        cls,
        endpoint: str,
        robot: str,
        *,
        run: str | None = None,
        timeout: float = 10.0,
        keys: KeyFolder | None = None,
    ) -> Self:
        """Connect to the router at an endpoint, waiting up to `timeout` [s] for it to come up.

        Args:
            endpoint: such as "tcp/127.0.0.1:7447".
            robot: whose bus it is, or POOL; part of the keys.
            run: see the attribute.
            timeout: [s].
            keys: of this service, for endpoints with TLS.
        """
        if robot != POOL:
            checked_robot(robot)  # a bad name is the caller's error: do not wait first
        bus = cls(open_client(endpoint, timeout, keys), robot, run)
        bus.watch(ROUTER, _shout)
        return bus

    def publish(self, message: Message) -> None:
        """Send a message on its topic; dropped where the network or a receiver cannot keep up."""
        self.send(type(message), message.address, encode(message))

    def send(self, kind: type[Message], address: str | None, payload: bytes) -> None:
        """Send an encoded message of some type; see `publish`."""
        try:
            self._publisher(kind, address).put(payload)
        except zenoh.ZError as error:
            raise SumoError(f"cannot publish {kind.__name__}: {error}") from None

    def subscribe(self, kind: type[M], callback: Callable[[M], None], address: str = ANY) -> None:
        """Give a callback every valid message of a type; the others are counted in `rejected`.

        Args:
            kind: type of message.
            callback: runs on a thread of its own; the next message waits for it.
            address: only messages to, or from, this service, where the topic has a key per service.
        """

        def receive(sample: zenoh.Sample) -> None:
            if self._closed:  # Zenoh still hands over what it had queued
                return
            try:
                message = decode(kind, sample.payload.to_bytes())
            except WireError as error:
                self._reject(error.reason, f"{sample.key_expr}: {error.detail}")
                return
            if self.run is not None and message.run != self.run and not kind.any_run:
                self._reject("run", f"{sample.key_expr}: {message.run}, this is {self.run}")
                return
            callback(message)

        whose = [POOL] if kind.pooled else [self.robot]
        if kind.of_all and self.robot != POOL:
            whose.append(POOL)
        for robot in whose:
            key = topic_key(robot, kind.topic, address if kind.addressed_by else None)
            self._receivers.append(self._session.declare_subscriber(key, receive))

    def newest(self, kind: type[M], address: str = ANY) -> Newest[M]:
        """Subscribe with a slot that holds the newest message."""
        slot: Newest[M] = Newest()

        def receive(message: M) -> None:
            if not slot.put(message):
                self._reject("stale", f"{kind.__name__} {message.order}")

        self.subscribe(kind, receive, address)
        return slot

    def inbox(self, kind: type[M], address: str = ANY) -> SimpleQueue[M]:
        """Subscribe with a queue of all messages; `get(timeout=...)` has the deadline."""
        queue: SimpleQueue[M] = SimpleQueue()

        def receive(message: M) -> None:
            if queue.qsize() < INBOX_LIMIT:
                queue.put(message)
            else:
                self._reject("overflow", f"{kind.__name__} {message.order}")

        self.subscribe(kind, receive, address)
        return queue

    def announce(self, role: str, id: str, build: str = "-") -> Member:  # noqa: A002
        """Be seen as a living member of a role until the bus is closed or the process dies.

        Subscribe first: who sees the member can then reach it.
        """
        member = Member(role, id, SCHEMA, build)
        key = alive_key(POOL if role == WORKER else self.robot, member)
        self._tokens.append(self._session.liveliness().declare_token(key))
        return member

    def watch(
        self, role: str = ANY, on_change: Callable[[Member, bool], None] | None = None
    ) -> Members:
        """Follow who is alive in a role (or in ANY), those that were there before included.

        The members arrive a few milliseconds after the call. A killed process leaves within
        milliseconds, a frozen or cut-off one after a second.
        """
        members = Members(on_change)

        def receive(sample: zenoh.Sample) -> None:
            if (member := parse_alive(str(sample.key_expr))) is None:
                self._reject("malformed", str(sample.key_expr))
            else:
                members.update(member, sample.kind == zenoh.SampleKind.PUT)

        liveliness = self._session.liveliness()
        for key in self._tokens_of(role):
            self._receivers.append(liveliness.declare_subscriber(key, receive, history=True))
        return members

    def close(self) -> None:
        """Leave: stop receiving, withdraw what was announced, disconnect.

        A thread that still publishes gets a SumoError. Publishers are left to the session: Zenoh
        cannot undeclare one that another thread is using.
        """
        self._closed = True
        for entity in (*self._receivers, *self._tokens):
            entity.undeclare()
        self._receivers.clear()
        self._tokens.clear()
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _tokens_of(self, role: str) -> list[str]:
        """Key expressions of the tokens of a role as this side sees it."""
        if role == ROUTER:
            return [router_tokens()]
        if self.robot == POOL:  # workers see the services of all robots
            return [alive_keys(ANY, role)]
        keys = [] if role == WORKER else [alive_keys(self.robot, role)]
        return [*keys, alive_keys(POOL, WORKER)] if role in (ANY, WORKER) else keys

    def _publisher(self, kind: type[Message], address: str | None) -> zenoh.Publisher:
        where = (kind, address)
        with self._lock:
            if where not in self._publishers:
                priority = zenoh.Priority.REAL_TIME
                self._publishers[where] = self._session.declare_publisher(
                    topic_key(POOL if kind.pooled else self.robot, kind.topic, address),
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.BACKGROUND if kind.background else priority,
                    express=not kind.background,
                )
            return self._publishers[where]

    def _reject(self, reason: str, detail: str) -> None:
        with self._lock:
            self.rejected[reason] += 1
            first = self.rejected[reason] == 1
        if first:
            _log.warning("dropped a message (%s; from now on only counted): %s", reason, detail)


def _shout(router: Member, alive: bool) -> None:
    """Say, in the log of each service, that its router is open to everybody."""
    if alive and router.build == INSECURE:
        _log.warning(SHOUT)
