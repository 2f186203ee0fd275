"""Trial workers on other hosts, as a campaign sees them."""

import itertools
import json
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from queue import Empty
from typing import Any

from sumo_dist.bench.campaign.job import Job, run_trial
from sumo_dist.bench.campaign.processes import JobLost, Runners, processes
from sumo_dist.dispatch.workers import misfit
from sumo_dist.launch.launcher import dialled, listening
from sumo_dist.services.router import RouterOptions, opened, revoked_by
from sumo_dist.terminal import say
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import Member
from sumo_dist.wire.notices import TrialReply, TrialRequest
from sumo_dist.wire.session import is_secure

BENCH = "bench"  # in the place of a robot's name in keys
ROLE = "trial-worker"
RESEND_S = 1.0  # until a request that is not answered is sent again

Row = dict[str, Any]
Tell = Callable[[str], None]


@contextmanager
def trial_runners(jobs: int, router: RouterOptions | None, build: str) -> Iterator[Runners[Job]]:
    """Yield who runs trials: processes of this machine, and workers of others.

    Args:
        jobs: processes; without a router at least one.
        router: where to listen for workers, if any are wanted.
        build: engine build that workers must have.
    """
    with processes(run_trial, jobs if router else max(1, jobs)) as runners:
        if router is None:
            yield runners
            return
        with remote_workers(router, build, runners, say):
            yield runners


@contextmanager
def remote_workers(
    router: RouterOptions, build: str, runners: Runners[Job], tell: Tell
) -> Iterator[None]:
    """Open a port for trial workers and let those that come run jobs.

    Args:
        router: where to listen, such as tls/0.0.0.0:7447, and with what keys.
        build: engine build that workers must have.
        runners: gets the workers.
        tell: takes notices.
    """
    endpoint, here = listening(router.listen), None
    if is_secure(endpoint):  # where the campaign itself needs no keys
        here = listening("tcp/127.0.0.1:0")
    router = replace(router, listen=endpoint, local=here)
    with (
        opened(router, revoked_by(router)),
        Bus.dial(here or dialled(endpoint), BENCH, run=uuid.uuid4().hex) as bus,
    ):
        numbers, present = itertools.count(), dict[str, threading.Event]()

        def on_change(member: Member, alive: bool) -> None:
            if not alive:
                if member.id in present:
                    present.pop(member.id).set()
            elif reason := misfit(member, build):
                tell(f"worker {member.id} gets no trials: {reason}")
            else:
                left = present[member.id] = threading.Event()
                runners.add(RemoteWorker(bus, member.id, numbers, left, tell))

        bus.watch(ROLE, on_change)
        tell(f"waiting for `sumo-dist trial-worker --connect` at {endpoint}")
        try:
            yield
        finally:
            for left in [*present.values()]:
                left.set()


class RemoteWorker:
    """A trial worker; it gets one trial at a time, and none any more once it leaves or refuses."""

    def __init__(
        self, bus: Bus, name: str, numbers: Iterator[int], left: threading.Event, tell: Tell
    ) -> None:
        """Take note of a worker; `numbers` are the campaign's, `left` is set when it leaves."""
        self._bus, self._name, self._numbers = bus, name, numbers
        self._left, self._tell = left, tell
        self._replies = None

    def __call__(self, job: Job) -> Row:
        """Ask for a trial until its row comes; JobLost if the worker leaves or refuses."""
        if self._left.is_set():
            raise JobLost  # it left while it had nothing to do
        if self._replies is None:
            self._replies = self._bus.inbox(TrialReply, self._name)
        request = self._request(job)
        while not self._left.is_set():
            self._bus.publish(request)
            try:
                reply = self._replies.get(timeout=RESEND_S)
            except Empty:
                continue
            if reply.number != request.number:
                continue  # an answer that came twice
            row, reason = checked_row(job, reply)
            if row is not None:
                return row
            self._tell(f"worker {self._name} gets no trials: {reason}")
            raise JobLost
        self._tell(f"worker {self._name} has left; its trial goes to another")
        raise JobLost

    def _request(self, job: Job) -> TrialRequest:
        run = self._bus.run or ""
        number = next(self._numbers)
        return TrialRequest(run, self._name, number, job.trial.variant, job.episode.to_json())


def checked_row(job: Job, reply: TrialReply) -> tuple[Row | None, str]:
    """Return a reply's row, or None and why it does not count."""
    if reply.refusal:
        return None, reply.refusal
    try:
        row = json.loads(reply.row)
        wanted = {key: value for key, value in job.settings.items() if key != "provenance"}
        differ = [key for key, value in wanted.items() if row[key] != value]
    except (ValueError, TypeError, KeyError) as error:
        return None, f"its answer is not a row of a journal ({error!r})"
    if differ:
        return None, f"its trials differ in {', '.join(differ)}: install the same code there"
    return row, ""
