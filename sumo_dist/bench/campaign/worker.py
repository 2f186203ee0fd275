"""Runs whole episodes for a campaign on another host. Keeps nothing but its newest answers."""

import json
import logging
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from multiprocessing import connection
from multiprocessing.connection import Connection
from typing import Any

from sumo_dist.bench.campaign.job import run_alone
from sumo_dist.bench.campaign.processes import Processes
from sumo_dist.bench.campaign.remote import BENCH, ROLE
from sumo_dist.bench.layout import checked_engine
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.launch.serve import service
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.provenance import cores
from sumo_dist.services.worker import unique_name
from sumo_dist.wire.bus import Bus, Newest
from sumo_dist.wire.keys import checked_name
from sumo_dist.wire.messages import TrialReply, TrialRequest
from sumo_dist.wire.session import DEFAULT_ENDPOINT

WAKE_S = 0.1  # how often requests and the order to stop are looked for

log = logging.getLogger("sumo_dist.trials")


@dataclass(frozen=True)
class Options:
    """A worker that runs trials.

    Attributes:
        connect: the campaign's endpoint, see `--listen` of the benches.
        name: unique among the workers; by default host and process.
        jobs: trials at a time; by default one for each core.
        engine: kind of rollout engine that it offers, see rollout.make_engine.
    """

    connect: str = DEFAULT_ENDPOINT
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
    with Bus.dial(options.connect, BENCH) as bus, Processes(play, options.jobs) as processes:
        slots = [TrialSlot(f"{options.name}.{i}", bus, processes) for i in range(options.jobs)]
        for slot in slots:
            bus.announce(ROLE, slot.name, build)
        while not stop.is_set():
            for slot in slots:
                slot.look()
            busy = {slot.running: slot for slot in slots if slot.running is not None}
            if not busy:
                stop.wait(WAKE_S)
            for ready in connection.wait(list(busy), WAKE_S):
                busy[ready].finish()  # pyright: ignore[reportArgumentType]  # they are the keys


class TrialSlot:
    """Takes one trial at a time, and answers again when it is asked again."""

    def __init__(self, name: str, bus: Bus, processes: "Processes[Question, Row]") -> None:
        """Listen for requests to a name."""
        self.name = name
        self.running: Connection | None = None
        self._bus = bus
        self._processes = processes
        self._requests: Newest[TrialRequest] = bus.newest(TrialRequest, address=name)
        self._request: TrialRequest | None = None
        self._answer: TrialReply | None = None

    def look(self) -> None:
        """Start what is newly asked for; a trial that nobody waits for any more is given up."""
        request = self._requests.wait(0.0)
        if request is None:
            return
        if self._request is not None and same(request, self._request):
            if self._answer is not None:
                self._bus.publish(self._answer)
            return
        if self.running is not None:
            self._processes.end(self.running)
        self._request, self._answer = request, None
        log.info(
            "%s: %s seed %s", self.name, request.episode.get("task"), request.episode.get("seed")
        )
        question = request.variant, request.episode, request.planner
        self.running = self._processes.start(question)

    def finish(self) -> None:
        """Answer with the row of the trial that has ended, or say why there is none."""
        assert self.running is not None and self._request is not None, "something has ended"
        running, self.running = self.running, None
        row, refusal = "", ""
        try:
            found = self._processes.result(running)
            row = json.dumps(found, allow_nan=False) if found else ""
            refusal = "" if found else "the process of the trial died (out of memory?)"
        except SumoError as error:
            refusal = str(error)
            log.error("%s refused: %s", self.name, refusal)
        asked = self._request
        self._answer = TrialReply(asked.run, self.name, asked.number, row, refusal)
        self._bus.publish(self._answer)


Row = Mapping[str, Any]
Question = tuple[str, Mapping[str, Any], Mapping[str, Any]]
"""Variant, fields of the episode, fields of its planner."""


def play(question: Question) -> Row:
    """Run a trial in this process."""
    variant, episode, planner = question
    try:
        config = EpisodeConfig(planner=PlannerConfig.from_settings(planner), **episode)
    except TypeError as error:
        raise UsageError(f"an episode of another version: {error}") from None
    return run_alone(variant, config)


def same(one: TrialRequest, other: TrialRequest) -> bool:
    """Whether two requests are the same question."""
    return (one.run, one.number) == (other.run, other.number)
