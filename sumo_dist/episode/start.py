"""The first state of an episode, decided by task and seed."""

import numpy as np

from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.task import Task


def draw_start(task: Task, seed: int) -> np.ndarray:
    """State (nq + nv,) that the task's reset draws for a seed."""
    return task.reset(np.random.default_rng(seed), Start.of(task.scene))
