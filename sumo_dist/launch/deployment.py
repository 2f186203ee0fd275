"""A run by services: one process each on this machine, and whoever else dials the router."""

import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import UsageError
from sumo_dist.launch import serve
from sumo_dist.launch.launcher import Launcher, Service, dialled, listening
from sumo_dist.tasks import load_task


@dataclass(frozen=True)
class Crew:
    """Who takes part in a run.

    Attributes:
        episode: what to do.
        workers: rollout workers on this machine.
        threads: rollout threads of each.
        out: folder of the run.
        viewer: "web", "native" or "none"; None leaves out the tracer.
        speed: of the realtime clock; None fits it to the planner.
        wait: how long the robot waits for an answer [s].
        resume_wait: how long a stopped robot waits to be told to go on [s].
    """

    episode: EpisodeConfig
    workers: int
    threads: int
    out: Path
    viewer: str | None
    speed: float | None
    wait: float
    resume_wait: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.wait <= 3600:
            raise UsageError(f"wait must be in (0, 3600] s, got {self.wait}")
        if not 0 <= self.resume_wait <= 86400:
            raise UsageError(f"resume-wait must be from 0 to 86400 s, got {self.resume_wait}")


def run_distributed(crew: Crew, listen: str) -> int:
    """Start everybody, wait for the robot to end, stop everybody; return the robot's exit code."""
    endpoint = listening(listen)
    with Launcher() as launcher:
        launcher.start(Service("router", "router", serve.Router(endpoint)))
        for service in services(crew, dialled(endpoint)):
            launcher.start(service)
        code = launcher.wait_for("robot-interface")
        if crew.viewer is not None:
            launcher.let_finish("tracer")
        return code


def services(crew: Crew, endpoint: str) -> Iterator[Service]:
    """Yield the services of a run that dial an endpoint, the robot last."""
    episode = crew.episode
    bus: dict[str, Any] = {
        "connect": endpoint,
        "robot": load_task(episode.task).scene.robot.name,
    }
    run = {**bus, "run": uuid.uuid4().hex[:12]}
    estimator = serve.Estimator(task=episode.task, estimator=episode.estimator, **bus)
    yield Service("state-estimator", "state-estimator", estimator)
    optimizer = serve.Optimizer(
        task=episode.task, planner=episode.planner, seed=episode.seed, engine=episode.engine, **run
    )
    yield Service("optimizer", "optimizer", optimizer)
    for i in range(crew.workers):
        worker = serve.Worker(name=f"local-{i}", threads=crew.threads, engine=episode.engine, **bus)
        yield Service(worker.name, "rollout-worker", worker, vital=False)
    if crew.viewer is not None:
        tracer = serve.Tracer(episode=episode, out=crew.out, viewer=crew.viewer, **run)
        yield Service("tracer", "tracer", tracer, vital=False)
    patience = {"wait": crew.wait, "resume_wait": crew.resume_wait}
    robot = serve.Robot(episode=episode, out=crew.out, speed=crew.speed, **patience, **run)
    yield Service("robot-interface", "robot-interface", robot)
