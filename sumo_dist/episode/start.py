"""The first state of an episode, decided by task and seed."""

import numpy as np

from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.model.settle import settled_stand
from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.task import Task


def draw_start(task: Task, seed: int) -> np.ndarray:
    """State (nq + nv,) that the task's reset draws for a seed."""
    model = compile_model(task.scene, PLANT)
    robot = task.scene.robot
    start = Start(model, StateIndex(model), settled_stand(robot), robot.base)
    return task.reset(np.random.default_rng(seed), start)
