"""What an operator is offered: what the task and the planner declare, as JSON has it."""

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from sumo_dist.control.floor import FloorPlan
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.config import FIXED
from sumo_dist.planner.ranges import Range, parameter_ranges, setting_ranges, weight_ranges
from sumo_dist.tasks import task_names
from sumo_dist.tasks.task import Task


def offer(config: EpisodeConfig, task: Task, floor: FloorPlan) -> dict[str, Any]:
    """Say what of an episode may be changed, what its numbers are called and what does not move.

    Args:
        config: of the episode.
        task: of the episode.
        floor: its floor plan.
    """
    parameters = parameter_ranges(task)
    robot = task.scene.robot.name
    return {
        "task": task.name,
        "source": config.task,
        "description": task.description,
        "robot": robot,
        "seed": config.seed,
        "clock": config.clock,
        "plant": config.plant,
        "estimator": config.estimator,
        "limit_s": config.time_limit or task.time_limit,
        "tasks": [name for name in task_names() if name.partition("/")[0] == robot],
        "terms": list(task.table.terms),
        "weights": _listed(weight_ranges(task).values()),
        "parameters": [_listed(numbers) for numbers in parameters.values()],
        "settings": _listed(
            range_ for name, range_ in setting_ranges(config.planner).items() if name not in FIXED
        ),
        "places": [name for name, numbers in parameters.items() if _is_place(numbers)],
        "frames": floor.frames,
        "fixed": floor.fixed,
    }


def _listed(ranges: Iterable[Range]) -> list[dict[str, Any]]:
    return [asdict(range_) for range_ in ranges]


def _is_place(numbers: tuple[Range, ...]) -> bool:
    """Whether a parameter is a point of the floor: two lengths."""
    return len(numbers) == 2 and all(number.unit == "m" for number in numbers)
