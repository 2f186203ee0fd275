"""`sumo-dist host-agent`: runs a host's services for as long as its launcher speaks to it.

What ties them to the launcher is what is said on the standard input, not a process or a connection:
a cable that is pulled out or a launcher that is frozen ends no process and closes no connection.
"""

import fcntl
import os
import queue
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from sumo_dist.errors import SumoError
from sumo_dist.hosts.installation import Installation
from sumo_dist.hosts.protocol import BEAT_S, LONGEST, SILENCE_S, Order, decoded, encoded
from sumo_dist.hosts.task_files import TASKS
from sumo_dist.launch.launcher import Launcher, Service
from sumo_dist.signals import on_ending
from sumo_dist.tasks import TASK_FILES
from sumo_dist.wire.keys import checked_name
from sumo_dist.wire.session import nobody_listens

BACKLOG = 2000  # lines that wait for a slow link; more of them are lost, the oldest first
AGENTS = Path("agents")  # in the host's folder: a lock for each that runs
_POLL_S = 0.05
_PREDECESSOR_S = 20.0  # an agent whose launcher fell silent has ended its services by then


@dataclass(frozen=True)
class Options:
    """Options of `host-agent`, which `sumo-dist run --hosts` starts.

    Attributes:
        run: the run that it belongs to.
        host: its host's name.
        identity: only say what is installed here.
    """

    run: str = "run"
    host: str = "host"
    identity: bool = False


def main(options: Options) -> int:
    """Serve a launcher on standard input and output."""
    if options.identity:
        sys.stdout.write(Installation.here().to_json() + "\n")
        return 0
    checked_name("run", options.run)
    checked_name("host", options.host)
    os.environ[TASK_FILES] = str(Path(TASKS).absolute())
    mailbox = Mailbox()
    on_ending(lambda *_: mailbox.end())
    with _alone(options), Outbox() as outbox:
        outbox.put("hello", installation=Installation.here().to_json(), folder=os.getcwd())
        with Launcher(piped=True) as launcher:
            agent = Agent(launcher, mailbox, outbox)
            agent.serve()
        agent.last_words()
    os._exit(0)  # threads may hang at a link that is down; nothing here is worth waiting for them


class Mailbox:
    """What the launcher says, and when it last did."""

    def __init__(self) -> None:
        """Listen."""
        self._said: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._heard = time.monotonic()
        threading.Thread(target=self._listen, daemon=True).start()

    def get(self, timeout: float) -> dict[str, Any] | None:
        """Return the next message; None if there is none yet.

        Raises:
            EOFError: the launcher has gone away, or has been silent for too long.
        """
        try:
            message = self._said.get(timeout=timeout)
        except queue.Empty:
            if time.monotonic() > self._heard + SILENCE_S:
                raise EOFError from None
            return None
        if message is None:
            raise EOFError
        return message

    def end(self) -> None:
        """Let the next `get` find that the launcher has gone."""
        self._said.put(None)

    def _listen(self) -> None:
        try:
            while line := sys.stdin.buffer.readline(LONGEST):
                self._heard = time.monotonic()
                self._said.put(decoded(line))
        except (SumoError, OSError, ValueError):
            pass
        self._said.put(None)


class Outbox:
    """What the launcher is told. Nobody here waits for a link that is slow or down."""

    def __init__(self) -> None:
        """Start with nothing to say."""
        self._lines: deque[bytes] = deque()
        self._dropped = 0
        self._changed = threading.Condition()
        self._writing = threading.Thread(target=self._write, daemon=True)
        self._over = False

    def __enter__(self) -> "Outbox":
        self._writing.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Say what is left, as far as that is quick."""
        with self._changed:
            self._over = True
            self._changed.notify()
        self._writing.join(1.0)

    def put(self, event: str, **more: Any) -> None:
        """Say something."""
        with self._changed:
            if len(self._lines) >= BACKLOG:
                self._lines.popleft()
                self._dropped += 1
            self._lines.append(encoded({"event": event, **more}))
            self._changed.notify()

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._lines or self._over)
                if not self._lines:
                    return
                line, dropped, self._dropped = self._lines.popleft(), self._dropped, 0
            if dropped:
                text = f"{dropped} lines were lost on the way to the launcher"
                line = encoded({"event": "log", "service": "host-agent", "text": text}) + line
            if not _written(line):
                return


def _written(line: bytes) -> bool:
    """Write a line to the launcher; whether it could be."""
    try:
        sys.stdout.buffer.write(line)
        sys.stdout.buffer.flush()
    except (OSError, ValueError):
        return False
    return True


class Agent:
    """Starts what it is told to, and says what becomes of it."""

    def __init__(self, launcher: Launcher, mailbox: Mailbox, outbox: Outbox) -> None:
        """Serve by these."""
        self._launcher, self._mailbox, self._outbox = launcher, mailbox, outbox
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._readers: dict[str, threading.Thread] = {}
        self._unready: dict[str, str] = {}  # endpoints by service
        self._beat = 0.0

    def serve(self) -> None:
        """Serve until the launcher says stop, goes away or falls silent."""
        try:
            while True:
                message = self._mailbox.get(_POLL_S)
                if message is not None and "stop" in message:
                    return
                for said in (message or {}).get("start", ()):
                    self._start(Order.parsed(said))
                self._look()
        except EOFError:
            return

    def last_words(self) -> None:
        """Say how the services ended that have been stopped."""
        self._look()
        self._outbox.put("stopped")

    def _start(self, order: Order) -> None:
        process = self._launcher.start(Service(order.name, order.command, order.words))
        assert process.stdout is not None, "it is piped"
        reader = threading.Thread(
            target=self._pass_on, args=(order.name, process.stdout), daemon=True
        )
        reader.start()
        self._running[order.name], self._readers[order.name] = process, reader
        if order.listens:
            self._unready[order.name] = order.listens

    def _look(self) -> None:
        """Say what has changed, and once a second that this agent lives."""
        for name, process in list(self._running.items()):
            if process.poll() is not None:
                self._readers.pop(name).join(1.0)  # its last words first
                del self._running[name]
                self._unready.pop(name, None)
                self._outbox.put("ended", service=name, code=process.returncode)
        for name, endpoint in list(self._unready.items()):
            if not nobody_listens(endpoint):
                del self._unready[name]
                self._outbox.put("ready", service=name)
        if time.monotonic() >= self._beat + BEAT_S:
            self._beat = time.monotonic()
            self._outbox.put("alive")

    def _pass_on(self, name: str, said: IO[bytes]) -> None:
        while line := said.readline(LONGEST):
            text = line.decode(errors="replace").rstrip()
            self._outbox.put("log", service=name, text=text)


@contextmanager
def _alone(options: Options) -> Iterator[None]:
    """Be the run's only agent on this host: one that the launcher lost may still be ending.

    Raises:
        SumoError: it does not end.
    """
    AGENTS.mkdir(exist_ok=True)
    path = AGENTS / f"{options.run}-{options.host}"
    with open(path, "wb") as lock:
        deadline = time.monotonic() + _PREDECESSOR_S
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise SumoError(
                        f"the agent of an earlier connection to {options.host} does not end"
                    ) from None
                time.sleep(_POLL_S)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
