"""The first state of an episode and the plant that starts there, decided by task and seed."""

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.plant.noise import plant_profile
from sumo_dist.plant.simulated import Plant
from sumo_dist.record.recording import Recording
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK


def draw_start(task: Task, seed: int) -> np.ndarray:
    """State (nq + nv,) that the task's reset draws for a seed."""
    return task.reset(np.random.default_rng(seed), Start.of(task.scene))


def make_plant(config: EpisodeConfig, task: Task) -> Plant:
    """Return the plant of an episode at its start."""
    start, profile = draw_start(task, config.seed), plant_profile(config.plant)
    return Plant(task.scene, start, config.estimator, profile, config.seed)


def make_guard(task: Task, plant: Plant, recording: Recording | None = None) -> CommandGuard:
    """Return what every command to a task's plant goes by; what it sends is recorded."""

    def send(targets: np.ndarray) -> None:
        if recording is not None:
            recording.targets.append(targets)
        plant.step(targets)

    return CommandGuard(task.scene.robot, plant.model, send, TICK)
