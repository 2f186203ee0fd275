"""Runs whole episodes for a campaign on another host. Keeps nothing but its newest answers."""

import json
import logging
import threading
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from sumo_dist.bench.campaign.job import run_alone
from sumo_dist.bench.campaign.processes import JobProcess
from sumo_dist.bench.campaign.remote import BENCH, ROLE
from sumo_dist.bench.layout import checked_engine
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.launch.serve import service
from sumo_dist.provenance import cores
from sumo_dist.services.worker import unique_name
from sumo_dist.startup import WithoutGraphics
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.keys import WORKER, checked_name
from sumo_dist.wire.notices import TrialReply, TrialRequest
from sumo_dist.wire.session import DEFAULT_ENDPOINT

WAKE_S = 0.1  # how often requests and the order to stop are looked for

log = logging.getLogger("sumo_dist.trials")


@dataclass(frozen=True)
class Options:
    """A worker that runs trials.

    Attributes:
        connect: the campaign's endpoint, see `--listen` of the benches.
        keys: folder from `sumo-dist keys host` for the role worker, for an endpoint with TLS.
        name: unique among the workers; by default host and process.
        jobs: trials at a time; by default one for each core.
        engine: kind of rollout engine that it offers, see rollout.make_engine.
    """

    connect: str = DEFAULT_ENDPOINT
    keys: Path | None = None
    name: str = field(default_factory=unique_name)
    jobs: int = field(default_factory=cores)
    engine: str = "auto"

    def __post_init__(self) -> None:
        checked_name("worker", self.name)
        if not 1 <= self.jobs <= 256:
            raise UsageError(f"jobs must be from 1 to 256, got {self.jobs}")


def main(options: Options) -> int:
    """Run trials until stopped."""
    with service() as stop:
        run(options, stop)
    return 0


def run(options: Options, stop: threading.Event) -> None:
    """Serve until told to stop; trials that are under way end with it."""
    _, build = checked_engine(options.engine)
    keys = keys_for(options.connect, options.keys, WORKER)
    with (
        WithoutGraphics(),
        Bus.dial(options.connect, BENCH, keys=keys) as bus,
        ThreadPoolExecutor(options.jobs) as threads,
    ):
        slots = [TrialSlot(f"{options.name}.{i}", bus) for i in range(options.jobs)]
        for slot in slots:
            bus.announce(ROLE, slot.name, build)
        try:
            for ended in as_completed([threads.submit(slot.serve, stop) for slot in slots]):
                ended.result()
        finally:
            stop.set()


class TrialSlot:
    """Takes one trial at a time, and answers again when it is asked again."""

    def __init__(self, name: str, bus: Bus) -> None:
        """Listen for requests to a name."""
        self.name = name
        self._bus = bus
        self._requests = bus.newest(TrialRequest, address=name)

    def serve(self, stop: threading.Event) -> None:
        """Run what is asked for, until told to stop."""
        request: TrialRequest | None = None
        answer: TrialReply | None = None
        while not stop.is_set():
            request = request or self._requests.wait(WAKE_S)
            if request is None:
                continue
            if answer is None or not same(answer, request):
                answer, newer = self._answer(request, stop)
            else:
                newer = None
            if answer is not None:
                self._bus.publish(answer)
            request = newer

    def _answer(
        self, request: TrialRequest, stop: threading.Event
    ) -> tuple[TrialReply | None, TrialRequest | None]:
        """Run a trial; give it up, without an answer, for another request or the order to stop."""
        log.info("%s: %s", self.name, request.episode)
        question = request.variant, request.episode
        with JobProcess(run_alone, question) as process:
            while not process.wait(WAKE_S):
                newer = self._requests.wait(0.0)
                if stop.is_set() or (newer is not None and not same(newer, request)):
                    return None, newer
            try:
                row = process.result()
                refusal = "" if row else "the process of the trial died (out of memory?)"
            except SumoError as error:
                row, refusal = None, str(error)
        if refusal:
            log.error("%s refused: %s", self.name, refusal)
        packed = json.dumps(row, allow_nan=False) if row else ""
        return TrialReply(request.run, self.name, request.number, packed, refusal), None


def same(one: TrialRequest | TrialReply, other: TrialRequest) -> bool:
    """Whether two messages are about the same question."""
    return (one.run, one.number) == (other.run, other.number)
