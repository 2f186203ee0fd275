"""A bad network on purpose: a bridge between two routers that spoils what passes.

Services behind it dial the one router, all others the other. Messages and tokens of living services
cross in both directions; rules say what happens to them on the way.
"""

import heapq
import threading
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import zenoh

from sumo_dist.errors import UsageError, unknown
from sumo_dist.faults.tamper import TAMPERS
from sumo_dist.wire.keys import SCHEMA
from sumo_dist.wire.session import open_client

LINK_RULES = ("drop", "delay", "duplicate", "cut")
RULES = (*LINK_RULES, *TAMPERS)

_OPEN_S = 30.0
_ECHO_S = 0.005  # from a message to its duplicate


@dataclass(frozen=True)
class Rule:
    """What happens to messages.

    Attributes:
        kind: "drop"; "delay" by delay_ms and up to jitter_ms more, which also changes their order;
            "duplicate"; "cut", the link is down and services vanish from each other's sight; or one
            of wire.tamper.
        share: of messages it happens to.
        topics: it happens to; empty means all.
        delay_ms, jitter_ms: of "delay".
    """

    kind: str
    share: float = 1.0
    topics: tuple[str, ...] = ()
    delay_ms: float = 0.0
    jitter_ms: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in RULES:
            raise unknown("rule", self.kind, RULES)
        if not 0 < self.share <= 1:
            raise UsageError(f"share must be in (0, 1], got {self.share}")

    def hits(self, key: str, rng: np.random.Generator) -> bool:
        """Whether it happens to a message this time."""
        topic = key.split("/")[3]
        return (not self.topics or topic in self.topics) and rng.random() < self.share


class Mangler:
    """The bridge. A context manager.

    Attributes:
        done: messages by what happened to them.
    """

    def __init__(self, near: str, far: str, seed: int) -> None:
        """Dial both routers."""
        self.done: Counter[str] = Counter()
        self._rng, self._lock = np.random.default_rng(seed), threading.RLock()
        self._rules: tuple[Rule, ...] = ()
        self._ends = (open_client(near, _OPEN_S), open_client(far, _OPEN_S))
        self._tokens: list[dict[str, zenoh.LivelinessToken]] = [{}, {}]  # that we hold, per end
        self._seen: list[set[str]] = [set(), set()]  # tokens of services, per end
        self._way: list[tuple[float, int, int, str, bytes]] = []
        self._sent, self._over = 0, threading.Event()
        self._courier = threading.Thread(target=self._deliver, daemon=True)
        self._receivers: list[Any] = []

    def __enter__(self) -> Self:
        self._courier.start()
        for end, session in enumerate(self._ends):
            # Keys of all versions: it is the receiver's part to refuse one.
            messages = session.declare_subscriber(
                f"sumo/v{SCHEMA}/**",
                lambda sample, end=end: self._message(end, sample),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            tokens = session.liveliness().declare_subscriber(
                "sumo/alive/**", lambda sample, end=end: self._token(end, sample), history=True
            )
            self._receivers += [messages, tokens]
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:  # Zenoh still hands over what it had queued, and the ends close in turn
            self._over.set()
        self._courier.join()
        for receiver in self._receivers:
            receiver.undeclare()
        for session in self._ends:
            session.close()

    def set(self, rules: tuple[Rule, ...]) -> None:
        """Let these rules hold from now on, instead of those before."""
        with self._lock:
            was, self._rules = self._is_cut(), rules
            if was != self._is_cut():
                for end in (0, 1):
                    for key in self._seen[end]:
                        self._show(1 - end, key, alive=not self._is_cut())

    def _is_cut(self) -> bool:
        return any(rule.kind == "cut" for rule in self._rules)

    def _message(self, end: int, sample: zenoh.Sample) -> None:
        key, payload, wait = str(sample.key_expr), sample.payload.to_bytes(), 0.0
        with self._lock:
            if self._over.is_set():
                return
            self.done["passed"] += 1
            for rule in self._rules:
                if not rule.hits(key, self._rng):
                    continue
                self.done[rule.kind] += 1
                if rule.kind in ("drop", "cut"):
                    return
                if rule.kind == "delay":
                    wait += (rule.delay_ms + rule.jitter_ms * self._rng.random()) / 1e3
                elif rule.kind == "duplicate":
                    self._send(1 - end, key, payload, wait + _ECHO_S)
                else:
                    payload = TAMPERS[rule.kind](payload, self._rng)
            self._send(1 - end, key, payload, wait)

    def _send(self, end: int, key: str, payload: bytes, wait: float) -> None:
        self._sent += 1
        if wait > 0:
            heapq.heappush(self._way, (time.monotonic() + wait, self._sent, end, key, payload))
        else:
            self._put(end, key, payload)

    def _put(self, end: int, key: str, payload: bytes) -> None:
        drop = zenoh.CongestionControl.DROP
        self._ends[end].put(key, payload, congestion_control=drop, express=True)

    def _deliver(self) -> None:
        """Send what was delayed when its time has come."""
        while not self._over.wait(0.001):
            with self._lock:
                while self._way and self._way[0][0] <= time.monotonic():
                    _, _, end, key, payload = heapq.heappop(self._way)
                    self._put(end, key, payload)

    def _token(self, end: int, sample: zenoh.Sample) -> None:
        key, alive = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        with self._lock:
            if self._over.is_set() or key in self._tokens[end]:  # at its end, and our own
                return
            (self._seen[end].add if alive else self._seen[end].discard)(key)
            if not self._is_cut():
                self._show(1 - end, key, alive)

    def _show(self, end: int, key: str, alive: bool) -> None:
        held = self._tokens[end]
        if alive and key not in held:
            held[key] = self._ends[end].liveliness().declare_token(key)
        elif not alive and key in held:
            held.pop(key).undeclare()
