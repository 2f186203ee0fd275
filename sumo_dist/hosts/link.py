"""The launcher's side of the agents: starts one on a host, speaks to it, passes on what it says."""

import subprocess
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import IO, Any

from sumo_dist.errors import SumoError
from sumo_dist.hosts.install import program
from sumo_dist.hosts.inventory import Host
from sumo_dist.hosts.protocol import BEAT_S, LONGEST, SILENCE_S, decoded, encoded
from sumo_dist.hosts.remote import Shell


@dataclass(frozen=True)
class Said:
    """Something that a host's agent said.

    Attributes:
        link: by which it came.
        event: see `protocol`; and "lost", when the link has ended or is silent.
        content: of the message.
    """

    link: "Link"
    event: str
    content: dict[str, Any]


class Link:
    """An agent on a host. It ends its services when this object or this process is gone."""

    def __init__(self, host: Host, run: str, said: "SimpleQueue[Said]") -> None:
        """Start an agent; what it says is put into a queue."""
        self.host = host
        self._said = said
        self._heard: float | None = None  # time.monotonic() of its last word, None before the first
        self._lost = False
        self._lock = threading.Lock()
        command = Shell(host).command(
            f"exec {program(host)} host-agent --run {run} --host {host.name}"
        )
        try:
            # A group of its own: Ctrl-C reaches the launcher alone, which stops all in order.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            raise SumoError(f"host {host.name}: cannot start ssh: {error.strerror}") from None
        assert self._process.stdout and self._process.stderr, "they are pipes"
        for stream, read in (
            (self._process.stdout, self._listen),
            (self._process.stderr, self._complaints),
        ):
            threading.Thread(target=read, args=(stream,), daemon=True).start()
        threading.Thread(target=self._beat, daemon=True).start()

    @property
    def is_lost(self) -> bool:
        """Whether it has ended, or was given up."""
        return self._lost

    def say(self, message: dict[str, Any]) -> None:
        """Tell the agent something; what a lost one is told is lost, too."""
        with self._lock:
            assert self._process.stdin is not None, "it is a pipe"
            with suppress(OSError, ValueError):
                self._process.stdin.write(encoded(message))
                self._process.stdin.flush()

    def end(self) -> None:
        """Let it go: an agent that is still there ends its services."""
        self._lost = True
        with self._lock, suppress(OSError, ValueError):
            assert self._process.stdin is not None, "it is a pipe"
            self._process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(BEAT_S)
        self._process.kill()

    def _beat(self) -> None:
        while self._process.poll() is None:
            self.say({"alive": True})
            if self._heard is not None and time.monotonic() > self._heard + SILENCE_S:
                self._lose(f"says nothing for {SILENCE_S:.0f} s")
                return
            time.sleep(BEAT_S)

    def _listen(self, stream: IO[bytes]) -> None:
        why = "its connection has ended"
        try:
            while line := stream.readline(LONGEST):
                if self._heard is None and not line.startswith(b"{"):
                    continue  # of the user's shell there, which greets
                message = decoded(line)
                self._heard = time.monotonic()
                self._said.put(Said(self, str(message.get("event")), message))
        except (OSError, ValueError):
            pass
        except SumoError as error:
            why = str(error)
        self._lose(why)

    def _complaints(self, stream: IO[bytes]) -> None:
        """Pass on what ssh says, or the shell."""
        while line := stream.readline(LONGEST):
            text = line.decode(errors="replace").rstrip()
            self._said.put(Said(self, "log", {"service": "ssh", "text": text}))

    def _lose(self, why: str) -> None:
        with self._lock:
            if self._lost:
                return
            self._lost = True
        self._process.kill()
        self._said.put(Said(self, "lost", {"why": why}))
