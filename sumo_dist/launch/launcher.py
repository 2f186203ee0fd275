"""Starts every service of a run on this machine, watches them, and stops them all."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any, get_type_hints

import tyro

from sumo_dist.errors import SumoError
from sumo_dist.terminal import say
from sumo_dist.wire.session import checked_endpoint

PARENT = "SUMO_DIST_PARENT"  # a service whose launcher dies ends too
STOP_S = 5.0  # services get this long to end before they are killed
FINISH_S = 20.0  # and those that end by themselves: a tracer may have much left to write


@dataclass(frozen=True)
class Service:
    """A process of a run.

    Attributes:
        name: shown to the user.
        command: subcommand of sumo-dist.
        options: its options as a dataclass, or as words of a command line.
        vital: the run cannot go on without it.
        prefix: command that becomes the service's in the same process, such as `env` or `ip netns
            exec`.
    """

    name: str
    command: str
    options: Any
    vital: bool = True
    prefix: tuple[str, ...] = ()

    @property
    def words(self) -> tuple[str, ...]:
        """Its options as words of a command line."""
        return self.options if isinstance(self.options, tuple) else tuple(flags(self.options))


def flags(options: Any, prefix: str = "") -> Iterator[str]:
    """Command-line flags that say the same as a dataclass of options."""
    for f in fields(options):
        value = getattr(options, f.name)
        name = f"{prefix}{f.name.replace('_', '-')}"
        if is_dataclass(value):
            yield from flags(value, f"{name}.")
        elif isinstance(value, bool):
            yield f"--{name}" if value else f"--{prefix}no-{f.name.replace('_', '-')}"
        elif isinstance(value, tuple):
            if f.name in _appended(type(options)):
                yield from (text for item in value for text in (f"--{name}", str(item)))
            elif value:
                yield from (f"--{name}", *map(str, value))
        else:
            yield from (f"--{name}", str(value))


@cache
def _appended(kind: type) -> set[str]:
    """Names of options that are repeated, with one value each."""
    hints = get_type_hints(kind, include_extras=True)
    append = tyro.conf.UseAppendAction
    return {name for name, hint in hints.items() if append in getattr(hint, "__metadata__", ())}


class Launcher:
    """The processes of one run. A context manager: leaving it stops them all."""

    def __init__(self, poll_s: float = 0.05, piped: bool = False) -> None:
        """Start with none; `piped` hands over what they say as `stdout` of their processes."""
        self._poll_s = poll_s
        self._piped = piped
        self._services: dict[str, tuple[Service, subprocess.Popen[bytes]]] = {}
        self._started: list[subprocess.Popen[bytes]] = []
        self._noted: set[str] = set()

    def start(self, service: Service) -> subprocess.Popen[bytes]:
        """Start a service in a process group of its own: Ctrl-C reaches only the launcher."""
        python = (sys.executable, "-P", "-m", "sumo_dist")
        process = subprocess.Popen(
            [*service.prefix, *python, service.command, *service.words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if self._piped else None,
            stderr=subprocess.STDOUT if self._piped else None,
            start_new_session=True,
            env={**os.environ, PARENT: str(os.getpid())},
        )
        self._services[service.name] = service, process
        self._started.append(process)
        return process

    def wait_for(self, name: str) -> int:
        """Return the exit code of a service when it ends; a vital one that ends first raises."""
        _, process = self._services[name]
        while process.poll() is None:
            time.sleep(self._poll_s)
            for other, (service, running) in self._services.items():
                if other != name and running.poll() is not None:
                    self._note(service, running.returncode)
        return process.returncode

    def let_finish(self, name: str) -> None:
        """Give a service that ends by itself the time to do so."""
        with suppress(subprocess.TimeoutExpired):
            self._services[name][1].wait(FINISH_S)

    def _note(self, service: Service, code: int) -> None:
        if service.vital:
            raise SumoError(f"{service.name} ended with exit code {code}; see its messages above")
        if service.name not in self._noted:
            self._noted.add(service.name)
            say(f"sumo-dist: {service.name} ended ({cause(code)}), the run goes on")

    def __enter__(self) -> "Launcher":
        return self

    def __exit__(self, *_: object) -> None:
        """Ask all to end, last started first; kill what does not, and say so."""
        last_first = reversed(self._services.items())
        running = {name: p for name, (_, p) in last_first if p.poll() is None}
        for process in running.values():
            process.terminate()
        deadline = time.monotonic() + STOP_S
        for name, process in running.items():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)  # with what it has started itself
                process.wait()
                say(f"sumo-dist: {name} did not end within {STOP_S:g} s and was killed")
        for process in self._started:
            if (process.poll() or 0) < 0:  # killed: what it has started itself lives on
                _end_group(process.pid)


def _end_group(leader: int) -> None:
    """Kill what is left of the process group of a leader that has ended."""
    with suppress(ProcessLookupError, PermissionError):  # nothing is left
        try:
            os.kill(leader, 0)  # a group's number is not given away, unless nothing is left of it
        except ProcessLookupError:
            os.killpg(leader, signal.SIGKILL)


def cause(code: int) -> str:
    """Say how a process ended, of its exit code."""
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def listening(endpoint: str) -> str:
    """Return an endpoint to listen on, checked; its port 0 is replaced by a free one."""
    host, _, port = endpoint.rpartition(":")
    if port == "0":
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            endpoint = f"{host}:{probe.getsockname()[1]}"
    return checked_endpoint(endpoint)


def dialled(endpoint: str) -> str:
    """Return how this machine reaches a router that listens on an endpoint."""
    return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
