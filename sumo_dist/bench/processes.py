"""Independent jobs in processes of their own, which die with the process that asked for them."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from sumo_dist.errors import SumoError

J = TypeVar("J")
R = TypeVar("R")


def run_each(
    function: Callable[[J], R], jobs: Sequence[J], processes: int
) -> Iterator[tuple[J, R | None]]:
    """Yield each job with its result as it ends; None where its process died.

    Leaving the iterator early ends what is running. A SumoError of a job is raised here.

    Args:
        function: importable by name; so must be what a job is made of.
        jobs: one process each.
        processes: how many at a time.
    """
    waiting = deque(jobs)
    running: dict[Connection, tuple[J, BaseProcess]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                job = waiting.popleft()
                ours, process = _start(function, job)
                running[ours] = job, process
            ready = connection.wait(list(running))
            for ours in [ours for ours in running if ours in ready]:
                job, process = running.pop(ours)
                yield job, _result(ours)
                process.join()
    finally:
        for _, process in running.values():
            process.terminate()
        for ours, (_, process) in running.items():
            process.join()
            ours.close()


def _start(function: Callable[[J], R], job: J) -> tuple[Connection, BaseProcess]:
    # Spawned, not forked: the parent may have threads.
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(function, job, theirs))
    process.start()
    theirs.close()
    return ours, process


def _result(ours: Connection) -> Any:
    with ours:
        try:
            result = ours.recv()
        except EOFError:
            return None
    if isinstance(result, SumoError):
        raise result
    return result


def _work(function: Callable[[J], R], job: J, theirs: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
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
