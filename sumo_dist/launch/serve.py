"""The services as commands: signals, logging and the launcher's death around each of them."""

import os
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from sumo_dist.launch import logs
from sumo_dist.launch.endpoint import router_endpoint
from sumo_dist.launch.launcher import PARENT
from sumo_dist.priority import go_first, lower_priority
from sumo_dist.services import control as control_service
from sumo_dist.services import estimator as estimator_service
from sumo_dist.services import optimizer as optimizer_service
from sumo_dist.services import robot as robot_service
from sumo_dist.services import router as router_service
from sumo_dist.services import tracer as tracer_service
from sumo_dist.services import worker as worker_service
from sumo_dist.signals import set_on_ending
from sumo_dist.wire.audit import audited
from sumo_dist.wire.session import is_secure

Control = control_service.ControlOptions
Estimator = estimator_service.EstimatorOptions
Optimizer = optimizer_service.OptimizerOptions
Robot = robot_service.RobotOptions
Router = router_service.RouterOptions
Tracer = tracer_service.TracerOptions
Worker = worker_service.WorkerOptions


def router(options: Router) -> int:
    """Route until stopped."""
    with service(first=True) as stop, ExitStack() as stack:
        if PARENT not in os.environ:  # else the launcher has left a note
            stack.enter_context(router_endpoint(options.local or options.listen, ""))
        if is_secure(options.listen):
            stack.enter_context(audited())
        router_service.serve(options, stop)
    return 0


def estimator(options: Estimator) -> int:
    """Estimate until stopped."""
    with service(first=True) as stop:
        estimator_service.run(options, stop)
    return 0


def optimizer(options: Optimizer) -> int:
    """Plan until stopped."""
    with service(first=True) as stop:
        optimizer_service.run(options, stop)
    return 0


def worker(options: Worker) -> int:
    """Roll out until stopped."""
    with service() as stop:
        worker_service.run(options, stop, aloud=PARENT not in os.environ)
    return 0


def tracer(options: Tracer) -> int:
    """Show and record until the run has ended."""
    with service() as stop:
        lower_priority()
        tracer_service.run(options, stop)
    return 0


def control(options: Control) -> int:
    """Serve the operator's page until stopped."""
    with service() as stop:
        control_service.run(options, stop)
    return 0


def robot(options: Robot) -> int:
    """Run one episode."""
    with service(first=True) as stop:
        return robot_service.run(options, stop)


@contextmanager
def service(first: bool = False) -> Iterator[threading.Event]:
    """Yield the event that says stop: set by the signals that end it and the launcher's death.

    With `first`, the service is one that the robot waits for.
    """
    logs.configure()
    if first:
        go_first()
    stop = threading.Event()
    set_on_ending(stop)
    if parent := os.environ.get(PARENT):
        watch = threading.Thread(target=_outlive_no, args=(int(parent), stop), daemon=True)
        watch.start()
    yield stop


def _outlive_no(parent: int, stop: threading.Event) -> None:
    """Stop when the launcher is gone, however it went."""
    while os.getppid() == parent and not stop.wait(1.0):
        pass
    stop.set()
