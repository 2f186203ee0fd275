"""`sumo-dist list`."""

import json
from dataclasses import asdict, dataclass

from sumo_dist.optim import OPTIMIZERS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.rollout import ENGINES
from sumo_dist.tasks import load_task, task_names


@dataclass(frozen=True)
class Options:
    """Options of `list`.

    Attributes:
        json: print one JSON object.
    """

    json: bool = False


def main(options: Options) -> int:
    """Print tasks with their cost tables, optimizers, engines and settings."""
    tasks = [load_task(name) for name in task_names()]
    settings = asdict(PlannerConfig())
    if options.json:
        listing = {
            "tasks": {
                task.name: {
                    "robot": task.scene.robot.name,
                    "time_limit_s": task.time_limit,
                    "cost": {term.name: term.weight for term in task.cost},
                    "parameters": {p.name: asdict(p) for p in task.parameters},
                }
                for task in tasks
            },
            "optimizers": OPTIMIZERS,
            "engines": ENGINES,
            "settings": settings,
        }
        print(json.dumps(listing, indent=2))
        return 0
    for task in tasks:
        print(f"{task}\n")
    print(f"optimizers: {', '.join(OPTIMIZERS)}")
    print(f"engines:    {', '.join(ENGINES)}")
    print("settings:   " + ", ".join(f"{key}={value}" for key, value in settings.items()))
    return 0
