"""Turns the robot's readings into the state that policy and planner act on, one per tick."""

import logging
import queue
import threading
from dataclasses import dataclass

from sumo_dist.errors import SumoError
from sumo_dist.estimate import make_estimator
from sumo_dist.estimate.readings import Readings
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import Sensors, State
from sumo_dist.wire.session import DEFAULT_ENDPOINT

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
    """Serve until told to stop. A reading that is sent again gets the same answer again."""
    model = compile_model(load_task(options.task).scene, PLANT)
    newest: State | None = None
    with Bus.dial(options.connect, options.robot) as bus:
        inbox = bus.inbox(Sensors)
        bus.announce("estimator", "main", options.estimator)
        estimate = make_estimator(options.estimator, model)
        while not stop.is_set():
            try:
                sensors = inbox.get(timeout=0.1)
            except queue.Empty:
                continue
            if newest is None or sensors.run != newest.run:
                estimate, newest = make_estimator(options.estimator, model), None
            if newest is None or sensors.tick > newest.tick:
                try:
                    newest = State(sensors.run, sensors.tick, estimate(_readings(sensors)))
                except SumoError as error:
                    log.error("%s", error)
                    continue
            if sensors.tick == newest.tick:
                bus.publish(newest)


def _readings(sensors: Sensors) -> Readings:
    return Readings(
        sensors.tick,
        sensors.truth,
        sensors.encoder_ms,
        sensors.encoders,
        sensors.mocap_ms,
        sensors.mocap,
    )
