"""Independent jobs on whatever takes them: processes of this machine, workers of others."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Generic, Protocol, TypeVar

from sumo_dist.errors import SumoError

J = TypeVar("J")
R = TypeVar("R")
J_in = TypeVar("J_in", contravariant=True)

POLL_S = 0.5  # how often pools look for what they are not woken by


class Again(Exception):
    """A job was lost by no fault of its own: give it to somebody else."""


class Pool(Protocol[J_in]):
    """Takes some jobs at a time."""

    @property
    def free(self) -> int:
        """How many more jobs it would take now."""
        ...

    def start(self, job: J_in) -> Connection:
        """Take a job; the connection is ready when there is news of it."""
        ...

    def result(self, ours: Connection) -> Any:
        """Return the result of a job whose connection is ready; None if its process died.

        Raises:
            Again: the job is to be started anew.
            SumoError: that of the job.
        """
        ...

    def tend(self) -> None:
        """Do what has to be done from time to time while jobs run."""
        ...


def run_each(jobs: Sequence[J], pools: Sequence[Pool[J]]) -> Iterator[tuple[J, Any]]:
    """Yield each job with its result as it ends; None where its process died.

    A SumoError of a job is raised here. The pools are the caller's to close, which ends what runs.
    """
    waiting = deque(jobs)
    running: dict[Connection, tuple[J, Pool[J]]] = {}
    while waiting or running:
        for pool in pools:
            pool.tend()
            while waiting and pool.free > 0:
                job = waiting.popleft()
                running[pool.start(job)] = job, pool
        ready = connection.wait(list(running), POLL_S)
        for ours in [ours for ours in running if ours in ready]:
            job, pool = running.pop(ours)
            try:
                result = pool.result(ours)
            except Again:
                waiting.appendleft(job)
            else:
                yield job, result


class Processes(Generic[J, R]):
    """Runs each job in a process of its own, which dies with this one."""

    def __init__(self, function: Callable[[J], R], limit: int) -> None:
        """Set up.

        Args:
            function: importable by name; so must be what a job is made of.
            limit: processes at a time.
        """
        self._function = function
        self._limit = limit
        self._running: dict[Connection, BaseProcess] = {}

    @property
    def free(self) -> int:
        """How many more jobs it would take now."""
        return self._limit - len(self._running)

    def start(self, job: J) -> Connection:
        """Start a process for a job."""
        context = multiprocessing.get_context("spawn")  # not forked: this process may have threads
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(self._function, job, theirs))
        process.start()
        theirs.close()
        self._running[ours] = process
        return ours

    def result(self, ours: Connection) -> R | None:
        """Return what a process that is done has sent; None if it died."""
        process = self._running.pop(ours)
        with ours:
            try:
                result = ours.recv()
            except EOFError:
                result = None
        process.join()
        if isinstance(result, SumoError):
            raise result
        return result

    def tend(self) -> None:
        """Do nothing: processes need no care."""

    def end(self, ours: Connection) -> None:
        """End a process that nobody waits for any more."""
        process = self._running.pop(ours)
        process.terminate()
        process.join()
        ours.close()

    def __enter__(self) -> "Processes[J, R]":
        return self

    def __exit__(self, *_: object) -> None:
        """End what is running."""
        for process in self._running.values():
            process.terminate()
        for ours in list(self._running):
            self.end(ours)


def _work(function: Callable[[J], R], job: J, theirs: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    try:
        result = function(job)
    except SumoError as error:
        result = error
    theirs.send(result)


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    connection.wait([parent.sentinel])
    os._exit(3)
