"""Turns the robot's readings into the state that policy and planner act on, one per tick.

It is started for no task: it takes up the episode that the robot is in.
"""

import logging
import queue
import threading
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError
from sumo_dist.estimate import make_estimator
from sumo_dist.estimate.readings import Readings
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task
from sumo_dist.wire.connection import Connection
from sumo_dist.wire.health import Counters, Heartbeat
from sumo_dist.wire.messages import EpisodeInfo, Sensors, State

JUMP = 50  # ticks; readings from further off count once two in a row are from there

log = logging.getLogger("sumo_dist.estimator")


@dataclass(frozen=True, kw_only=True)
class EstimatorOptions(Connection):
    """A state estimator.

    Attributes:
        connect: the router's endpoint.
        keys: folder from `sumo-dist keys host`, for an endpoint with TLS.
        robot: whose state to estimate.
    """

    role: ClassVar[str] = "robot"


def run(options: EstimatorOptions, stop: threading.Event) -> None:
    """Serve until told to stop."""
    server = EstimatorServer()
    inbox: queue.SimpleQueue[EpisodeInfo | Sensors] = queue.SimpleQueue()
    with options.dial() as bus:
        bus.subscribe(EpisodeInfo, inbox.put)
        bus.subscribe(Sensors, inbox.put)
        with Heartbeat(bus, "estimator", server.health):
            bus.announce("estimator", "main")
            while not stop.is_set():
                try:
                    state = server.answer(inbox.get(timeout=0.1))
                except queue.Empty:
                    continue
                if state is not None:
                    bus.publish(state)


class EstimatorServer:
    """Answers readings with states. A reading that is sent again gets the same answer again.

    Each episode begins with a fresh estimate.
    """

    def __init__(self) -> None:
        """Start with no episode."""
        self._run = ""
        self._kind = ""
        self._model: mujoco.MjModel | None = None
        self._newest: State | None = None
        self._far = -1  # tick of the last readings, if they came from far off
        self._failures = 0

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        estimate = getattr(self, "_estimate", None)
        tick = self._newest.tick if self._newest else -1
        counters = {"tick": tick, "outliers": getattr(estimate, "outliers", 0)}
        return self._kind or "waiting", {**counters, "failures": self._failures}

    def answer(self, message: EpisodeInfo | Sensors) -> State | None:
        """Take up an episode, or return the state at the readings' tick; None if there is none."""
        try:
            if isinstance(message, EpisodeInfo):
                self._enter(message)
                return None
            return self._state(message)
        except SumoError as error:
            self._failures += 1
            log.error("%s", error)
            return None

    def _enter(self, info: EpisodeInfo) -> None:
        if info.run == self._run:
            return
        config = EpisodeConfig.from_json(info.config)
        self._run, self._model = info.run, None
        self._model = compile_model(load_task(config.task).scene, PLANT)
        self._kind = config.estimator
        self._start_afresh()

    def _start_afresh(self) -> None:
        assert self._model is not None, "an episode was entered"
        self._estimate, self._newest = make_estimator(self._kind, self._model), None

    def _state(self, sensors: Sensors) -> State | None:
        if sensors.run != self._run or self._model is None:
            return None  # of an episode that is over, or that could not be entered
        if self._newest is not None:
            self._check_distance(sensors.tick, self._newest.tick)
        newest = self._newest
        if newest is None or sensors.tick > newest.tick:
            state = self._estimate(_readings(sensors))
            if not np.isfinite(state).all():  # and a filter does not forget that by itself
                self._start_afresh()
                raise SumoError("the sensors' packets make no sense: starting afresh")
            self._newest = newest = State(sensors.run, sensors.tick, state)
        return newest if sensors.tick == newest.tick else None

    def _check_distance(self, tick: int, newest: int) -> None:
        """Refuse readings from far off, until two in a row are from there.

        One reading of a wrong tick would otherwise keep out all that follow it.
        """
        before, self._far = self._far, -1
        if abs(tick - newest) <= JUMP:
            return
        if before >= 0 and abs(tick - before) <= JUMP:
            self._start_afresh()
            return
        self._far = tick
        raise SumoError(f"readings of tick {tick} after tick {newest}: dropped")


def _readings(sensors: Sensors) -> Readings:
    return Readings(
        sensors.tick,
        sensors.truth,
        sensors.encoder_ms,
        sensors.encoders,
        sensors.mocap_ms,
        sensors.mocap,
    )
