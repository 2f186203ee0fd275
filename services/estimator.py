"""Turns the robot's readings into the state that policy and planner act on, one per tick."""

import logging
import queue
import threading
import time
from dataclasses import dataclass

import mujoco
import numpy as np

from sumo_dist.errors import SumoError
from sumo_dist.estimate import make_estimator
from sumo_dist.estimate.readings import Readings
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.health import Counters, Pulse
from sumo_dist.wire.keys import BY_HAND
from sumo_dist.wire.messages import Sensors, State
from sumo_dist.wire.session import DEFAULT_ENDPOINT

SILENCE_S = 0.5  # after it, readings of the first tick are those of a robot that was started again
JUMP = 50  # ticks; readings from further off count once two in a row are from there

log = logging.getLogger("sumo_dist.estimator")


@dataclass(frozen=True)
class EstimatorOptions:
    """A state estimator.

    Attributes:
        task: decides the model, and with it what the readings are.
        connect: the router's endpoint.
        robot: whose state to estimate.
        estimator: "truth" or "lowpass".
    """

    task: str
    connect: str = DEFAULT_ENDPOINT
    robot: str = "spot"
    estimator: str = "truth"


def run(options: EstimatorOptions, stop: threading.Event) -> None:
    """Serve until told to stop."""
    model = compile_model(load_task(options.task).scene, PLANT)
    desk = Desk(options.estimator, model)
    with Bus.dial(options.connect, options.robot) as bus:
        inbox = bus.inbox(Sensors)
        with Pulse(bus, BY_HAND, "estimator", desk.health):
            bus.announce("estimator", "main", options.estimator)
            while not stop.is_set():
                try:
                    state = desk.answer(inbox.get(timeout=0.1))
                except queue.Empty:
                    continue
                if state is not None:
                    bus.publish(state)


class Desk:
    """Answers readings with states. A reading that is sent again gets the same answer again.

    Each run begins with a fresh estimate: one with another id, and one with the same, as a robot
    that is started by hand has, which begins at the first tick.
    """

    def __init__(self, estimator: str, model: mujoco.MjModel) -> None:
        """Estimate states of a scene's model."""
        self._kind, self._model = estimator, model
        self._estimate = make_estimator(estimator, model)
        self._newest: State | None = None
        self._heard = 0.0  # time.monotonic() of the last readings after the first tick's
        self._odd = -1  # tick of the last readings, if they came from far off
        self._failures = 0

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        outliers = getattr(self._estimate, "outliers", 0)
        tick = self._newest.tick if self._newest else -1
        return self._kind, {"tick": tick, "outliers": outliers, "failures": self._failures}

    def answer(self, sensors: Sensors) -> State | None:
        """Return the state at the readings' tick, None if there is none to be had."""
        newest, now = self._newest, time.monotonic()
        again = sensors.tick == 0 and now - self._heard > SILENCE_S
        if sensors.tick > 0:
            self._heard = now
        if newest is None or sensors.run != newest.run or again:
            self._estimate, newest = make_estimator(self._kind, self._model), None
        elif abs(sensors.tick - newest.tick) <= JUMP:
            self._odd = -1
        elif self._is_confirmed(sensors.tick):
            self._estimate, newest = make_estimator(self._kind, self._model), None
        else:
            self._failures += 1
            log.error("readings of tick %d after tick %d: dropped", sensors.tick, newest.tick)
            return None
        if newest is None or sensors.tick > newest.tick:
            try:
                state = self._estimate(_readings(sensors))
                if not np.isfinite(state).all():  # and a filter does not forget that by itself
                    self._estimate = make_estimator(self._kind, self._model)
                    raise SumoError("the sensors' packets make no sense: starting afresh")
            except SumoError as error:
                self._failures += 1
                log.error("%s", error)
                return None
            self._newest = newest = State(sensors.run, sensors.tick, state)
        return newest if sensors.tick == newest.tick else None

    def _is_confirmed(self, tick: int) -> bool:
        """Whether the readings before came from as far off: one that lies would keep out all."""
        before, self._odd = self._odd, tick
        confirmed = before >= 0 and abs(tick - before) <= JUMP
        if confirmed:
            self._odd = -1
        return confirmed


def _readings(sensors: Sensors) -> Readings:
    return Readings(
        sensors.tick,
        sensors.truth,
        sensors.encoder_ms,
        sensors.encoders,
        sensors.mocap_ms,
        sensors.mocap,
    )
