"""Independent jobs on whatever takes them: processes of this machine, workers on others."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import connection
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from sumo_dist.errors import SumoError, TaskError
from sumo_dist.launch.launcher import cause
from sumo_dist.startup import WithoutGraphics
from sumo_dist.terminal import say

J = TypeVar("J")


class JobLost(Exception):
    """A job was lost by no fault of its own: give it to another runner, and this one no more."""


Runner = Callable[[J], Any]
"""Runs one job at a time and returns its result, None if its process died.

It may raise JobLost, and the SumoError of the job.
"""


class Runners(Generic[J]):
    """Those who run jobs; more may be added from any thread while jobs run."""

    def __init__(self) -> None:
        """Start without any."""
        self._free: list[Runner[J]] = []
        self._news: SimpleQueue[tuple[Runner[J], J | None, Any]] = SimpleQueue()

    def add(self, runner: Runner[J]) -> None:
        """Let one more take jobs."""
        self._news.put((runner, None, None))

    def run_each(self, jobs: Sequence[J]) -> Iterator[tuple[J, Any]]:
        """Yield each job with its result as it ends.

        A TaskError of a job is its result: other tasks go on. Any other SumoError is raised here.
        """
        waiting = deque(jobs)
        if waiting:
            yield from self.run_asked(lambda: waiting.popleft() if waiting else None)

    def run_asked(self, next_job: Callable[[], J | None]) -> Iterator[tuple[J, Any]]:
        """Yield jobs with their results as they end, where a job may follow from results.

        Args:
            next_job: is asked whenever somebody is free; None says that there is no job now, and,
                if none is running either, that there will be none.
        """
        lost, running = deque[J](), 0
        while True:
            while self._free:
                job = lost.popleft() if lost else next_job()
                if job is None:
                    break
                work = self._free.pop(), job
                threading.Thread(target=self._work, args=work, daemon=True).start()
                running += 1
            if self._free and not running:
                return
            runner, job, result = self._news.get()
            if job is None:
                self._free.append(runner)
                continue
            running -= 1
            if isinstance(result, JobLost):
                lost.append(job)
                continue
            if isinstance(result, Exception) and not isinstance(result, TaskError):
                raise result
            self._free.append(runner)
            yield job, result

    def _work(self, runner: Runner[J], job: J) -> None:
        try:
            result = runner(job)
        except Exception as error:  # for the thread that called `run_each`
            result = error
        self._news.put((runner, job, result))


@contextmanager
def processes(function: Callable[[J], Any], limit: int) -> Iterator[Runners[J]]:
    """Yield runners that give each job a process of its own, and end what still runs.

    Args:
        function: importable by name; so must be what a job is made of.
        limit: processes at a time.
    """
    runners, running = Runners[J](), set[JobProcess]()

    def run(job: J) -> Any:
        with JobProcess(function, job) as process:
            running.add(process)
            try:
                return process.result()
            finally:
                running.discard(process)

    for _ in range(limit):
        runners.add(run)
    with WithoutGraphics():
        try:
            yield runners
        finally:
            for process in [*running]:
                process.end()


class JobProcess:
    """A job in a process of its own, which dies with this one. A context manager that ends it.

    It takes the environment of this one, which no thread may write meanwhile: the process would
    read it half written, and end with exit code 255.
    """

    def __init__(self, function: Callable[[Any], Any], job: Any) -> None:
        """Start it."""
        context = multiprocessing.get_context("spawn")  # not forked: this process has threads
        self._ours, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(function, job, theirs))
        self._process.start()
        theirs.close()

    def wait(self, timeout: float) -> bool:
        """Return whether it ends within a time [s]."""
        return self._ours.poll(timeout)

    def result(self) -> Any:
        """Wait for the job's result; None if the process died, the SumoError of the job raises."""
        try:
            result = self._ours.recv()
        except EOFError:
            self._process.join()
            say(f"the process of a job ended: {cause(self._process.exitcode or 0)}")
            result = None
        if isinstance(result, SumoError):
            raise result
        return result

    def end(self) -> None:
        """End the process; nothing happens if it has ended."""
        self._process.terminate()
        self._process.join()

    def __enter__(self) -> "JobProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self._ours.close()


def _work(function: Callable[[Any], Any], job: Any, theirs: Connection) -> None:
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
