"""A bad network on purpose: a bridge between two routers that disturbs what passes.

Services behind it dial one of the routers, all others the other one. Messages and liveliness tokens
cross in both directions; faults say what happens to them on the way.
"""

import heapq
import threading
import time
from collections import Counter
from typing import Any, Self

import numpy as np
import zenoh

from sumo_dist.faults.script import Fault
from sumo_dist.faults.tamper import TAMPERS
from sumo_dist.wire.keys import SCHEMA
from sumo_dist.wire.session import open_client

_OPEN_S = 30.0
_DUPLICATE_S = 0.005  # from a message to its duplicate
_QUEUE_S = 1.0  # a narrow link drops what would have to wait for longer


class FaultBridge:
    """The bridge. A context manager.

    Attributes:
        counts: messages by what happened to them.
    """

    def __init__(self, near: str, far: str, seed: int) -> None:
        """Dial both routers."""
        self.counts: Counter[str] = Counter()
        self._rng, self._lock = np.random.default_rng(seed), threading.RLock()
        self._faults: tuple[Fault, ...] = ()
        self._ends = (open_client(near, _OPEN_S), open_client(far, _OPEN_S))
        self._tokens: list[dict[str, zenoh.LivelinessToken]] = [{}, {}]  # declared here, per end
        self._alive: list[set[str]] = [set(), set()]  # tokens of services, per end
        self._delayed: list[tuple[float, int, int, str, bytes]] = []  # due [s], number, end, ...
        self._number, self._closed = 0, threading.Event()
        self._free = [0.0, 0.0]  # when a narrow link has sent what there is, per end
        self._sender = threading.Thread(target=self._send_delayed, daemon=True)
        self._subscribers: list[Any] = []

    def __enter__(self) -> Self:
        self._sender.start()
        for end, session in enumerate(self._ends):
            # Keys of all versions: refusing a version is the receiver's task.
            messages = session.declare_subscriber(
                f"sumo/v{SCHEMA}/**",
                lambda sample, end=end: self._on_message(end, sample),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            tokens = session.liveliness().declare_subscriber(
                "sumo/alive/**", lambda sample, end=end: self._on_token(end, sample), history=True
            )
            self._subscribers += [messages, tokens]
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:  # Zenoh still delivers what it has queued, and the ends close in turn
            self._closed.set()
        self._sender.join()
        for subscriber in self._subscribers:
            subscriber.undeclare()
        for session in self._ends:
            session.close()

    def set_faults(self, *faults: Fault) -> None:
        """Let these faults happen from now on, instead of those before."""
        with self._lock:
            was_cut, self._faults = self._is_cut(), faults
            if was_cut != self._is_cut():
                for end in (0, 1):
                    for key in self._alive[end]:
                        self._show(1 - end, key, alive=not self._is_cut())

    def _is_cut(self) -> bool:
        return any(fault.kind == "cut" for fault in self._faults)

    def _on_message(self, end: int, sample: zenoh.Sample) -> None:
        key, payload, delay = str(sample.key_expr), sample.payload.to_bytes(), 0.0
        with self._lock:
            if self._closed.is_set():
                return
            self.counts["passed"] += 1
            for fault in self._faults:
                if not fault.concerns(key.split("/")[3]) or self._rng.random() >= fault.share:
                    continue
                self.counts[fault.kind] += 1
                if fault.kind in ("drop", "cut"):
                    return
                if fault.kind == "delay":
                    delay += (fault.delay_ms + fault.jitter_ms * self._rng.random()) / 1e3
                elif fault.kind == "narrow":
                    waits = self._waits(end, len(payload), fault.kbit_s)
                    if waits > _QUEUE_S:
                        return
                    delay += waits
                elif fault.kind == "duplicate":
                    self._send(1 - end, key, payload, delay + _DUPLICATE_S)
                else:
                    payload = TAMPERS[fault.kind](payload, self._rng)
            self._send(1 - end, key, payload, delay)

    def _waits(self, end: int, size: int, kbit_s: float) -> float:
        """Time [s] until a narrow link has sent a message of some bytes, after those before it."""
        now = time.monotonic()
        done = max(now, self._free[end]) + size * 8e-3 / kbit_s
        if done - now <= _QUEUE_S:
            self._free[end] = done
        return done - now

    def _send(self, end: int, key: str, payload: bytes, delay: float = 0.0) -> None:
        """Send a message now or after a delay [s]."""
        if delay > 0:
            self._number += 1
            due = time.monotonic() + delay
            heapq.heappush(self._delayed, (due, self._number, end, key, payload))
        else:
            drop = zenoh.CongestionControl.DROP
            self._ends[end].put(key, payload, congestion_control=drop, express=True)

    def _send_delayed(self) -> None:
        while not self._closed.wait(0.001):
            with self._lock:
                while self._delayed and self._delayed[0][0] <= time.monotonic():
                    _, _, end, key, payload = heapq.heappop(self._delayed)
                    self._send(end, key, payload)

    def _on_token(self, end: int, sample: zenoh.Sample) -> None:
        key, alive = str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT
        with self._lock:
            if self._closed.is_set() or key in self._tokens[end]:  # the bridge's own token
                return
            (self._alive[end].add if alive else self._alive[end].discard)(key)
            if not self._is_cut():
                self._show(1 - end, key, alive)

    def _show(self, end: int, key: str, alive: bool) -> None:
        """Declare a service of the other end alive at this one, or no longer."""
        declared = self._tokens[end]
        if alive and key not in declared:
            declared[key] = self._ends[end].liveliness().declare_token(key)
        elif not alive and key in declared:
            declared.pop(key).undeclare()
