"""A run by services: one process each on this machine, and whoever else dials the router."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import UsageError
from sumo_dist.launch import serve
from sumo_dist.launch.endpoint import router_endpoint
from sumo_dist.launch.launcher import Launcher, Service, dialled, listening
from sumo_dist.services.tracer import EMBEDDED
from sumo_dist.tasks import load_task, task_source
from sumo_dist.terminal import say
from sumo_dist.wire.session import DEFAULT_ENDPOINT, is_secure, no_router, nobody_listens

_LOOPBACK = "tcp/127.0.0.1:0"


@dataclass(frozen=True)
class Deployment:
    """Which services take part in a run, and how.

    Attributes:
        episode: what to do first.
        workers: rollout workers on this machine.
        threads: rollout threads of each.
        out: folder of the run.
        viewer: "web", "native" or "none"; None leaves out the tracer.
        speed: of the realtime clock; None fits it to the planner.
        wait: how long the robot waits for an answer [s].
        resume_wait: how long a stopped robot waits to be told to stand [s].
        stay: the robot waits for another episode when one has ended.
        give_way: the workers let everything else on this machine go first.
        robot: its name on the bus; None takes the robot's own.
        priority: of it among those that its workers serve.
        trust: task files that its workers may run besides the episode's own, or folders of such.
        keys: this host's, a folder a role, for endpoints with TLS.
        insecure: the run's router takes anybody without keys.
        steered: a "web" viewer is within the operator's page, a service of this run; else it is a
            page by itself.
    """

    episode: EpisodeConfig
    workers: int
    threads: int
    out: Path
    viewer: str | None
    speed: float | None
    wait: float
    resume_wait: float = 0.0
    stay: bool = False
    give_way: bool = True
    robot: str | None = None
    priority: int = 0
    trust: tuple[Path, ...] = ()
    keys: Path | None = None
    insecure: bool = False
    steered: bool = True

    def __post_init__(self) -> None:
        if not 0 < self.wait <= 3600:
            raise UsageError(f"wait must be in (0, 3600] s, got {self.wait}")
        if not 0 <= self.resume_wait <= 86400:
            raise UsageError(f"resume-wait must be from 0 to 86400 s, got {self.resume_wait}")


def run_distributed(deployment: Deployment, listen: str | None) -> int:
    """Start everybody, wait for the robot to end, stop everybody; return the robot's exit code.

    Args:
        deployment: who takes part.
        listen: the router's endpoint; None takes the usual port, or a free one.
    """
    what = f"{load_task(deployment.episode.task).name} in {deployment.out}"
    listen = None if listen is None else listening(listen)
    outside = listen if listen is not None and is_secure(listen) else None
    # Where others need keys, the services of this machine have a port of their own.
    here = listen if outside is None else _LOOPBACK
    with router_endpoint(here, what) as endpoint, Launcher() as launcher:
        if listen is None and endpoint != DEFAULT_ENDPOINT:
            say(f"the port of {DEFAULT_ENDPOINT} is taken: this run is at {endpoint}")
        launcher.start(Service("router", "router", _router(deployment, endpoint, outside)))
        return _run(deployment, dialled(endpoint), launcher)


def _router(deployment: Deployment, here: str, outside: str | None) -> serve.Router:
    if outside is None:
        return serve.Router(here, insecure=deployment.insecure)
    return serve.Router(outside, here, _of_role(deployment, outside, "router"))


def _of_role(deployment: Deployment, endpoint: str, role: str) -> Path | None:
    """Folder with a role's keys for an endpoint; None if it needs none."""
    if deployment.keys is None or not is_secure(endpoint):
        return None
    return deployment.keys / role


def join(deployment: Deployment, endpoint: str) -> int:
    """Do the same at a router that is there, whose workers are used, too.

    Raises:
        SumoError: there is none.
    """
    if nobody_listens(endpoint):
        raise no_router(endpoint, 0.0)
    with Launcher() as launcher:
        return _run(deployment, endpoint, launcher)


def _run(deployment: Deployment, endpoint: str, launcher: Launcher) -> int:
    for service in services(deployment, endpoint):
        launcher.start(service)
    code = launcher.wait_for("robot-interface")
    if deployment.viewer is not None:
        launcher.let_finish("tracer")
    return code


def services(deployment: Deployment, endpoint: str) -> Iterator[Service]:
    """Yield the services of a run that dial an endpoint, the robot last.

    Only the robot is told what to do: the others take it up from the robot.
    """
    episode, keys = deployment.episode, partial(_of_role, deployment, endpoint)
    bus: dict[str, Any] = {
        "connect": endpoint,
        "robot": deployment.robot or load_task(episode.task).scene.robot.name,
    }
    page = deployment.steered and deployment.viewer == "web"
    if deployment.viewer is not None:  # first: it has most to load before it shows anything
        viewer = EMBEDDED if page else deployment.viewer
        tracer = serve.Tracer(out=deployment.out, viewer=viewer, **bus, keys=keys("tracer"))
        yield Service("tracer", "tracer", tracer, vital=False)
    if page:
        control = serve.Control(**bus, keys=keys("operator"))
        yield Service("control", "control", control, vital=False)
    yield Service("state-estimator", "state-estimator", serve.Estimator(**bus, keys=keys("robot")))
    optimizer = serve.Optimizer(
        engine=episode.engine, priority=deployment.priority, **bus, keys=keys("optimizer")
    )
    yield Service("optimizer", "optimizer", optimizer)
    own = (Path(task_source(episode.task)),) if episode.task.endswith(".py") else ()
    for i in range(deployment.workers):
        worker = serve.Worker(
            connect=endpoint,
            keys=keys("worker"),
            name=f"local-{i}",
            threads=deployment.threads,
            engine=episode.engine,
            give_way=deployment.give_way,
            trust=(*own, *deployment.trust),
        )
        yield Service(worker.name, "rollout-worker", worker, vital=False)
    robot = serve.Robot(
        episode=episode,
        out=deployment.out,
        speed=deployment.speed,
        wait=deployment.wait,
        resume_wait=deployment.resume_wait,
        stay=deployment.stay,
        **bus,
        keys=keys("robot"),
    )
    yield Service("robot-interface", "robot-interface", robot)
