"""`sumo-dist list`."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import tyro

from sumo_dist.optim import OPTIMIZERS
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.settings import SETTINGS
from sumo_dist.rollout import ENGINES
from sumo_dist.tasks import load_task, task_names
from sumo_dist.tasks.task import Task


@dataclass(frozen=True)
class Options:
    """Options of `list`.

    Attributes:
        task: show the cost terms, parameters and settings of these, names or files, and no others.
        json: print one JSON object.
    """

    task: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    json: bool = False


def main(options: Options) -> int:
    """Print tasks, settings of the planner, optimizers and engines, or some tasks in full."""
    tasks = [load_task(name) for name in options.task or task_names()]
    if options.json:
        print(json.dumps(listing(tasks), indent=2))
    elif options.task:
        print("\n\n".join(f"{task.description or task.name}\n{task}" for task in tasks))
    else:
        print("\n".join(overview(tasks)))
    return 0


def listing(tasks: Iterable[Task]) -> dict[str, Any]:
    """All there is, as JSON has it."""
    return {
        "tasks": {
            task.name: {
                "description": task.description,
                "robot": task.scene.robot.name,
                "time_limit_s": task.time_limit,
                "cost": {term.name: term.weight for term in task.cost},
                "parameters": {p.name: asdict(p) for p in task.parameters},
                "settings": dict(task.planner),
            }
            for task in tasks
        },
        "optimizers": OPTIMIZERS,
        "engines": ENGINES,
        "settings": asdict(PlannerConfig()),
        "valid": {name: setting.valid for name, setting in SETTINGS.items()},
    }


def overview(tasks: Iterable[Task]) -> Iterator[str]:
    """Lines: a task each, then a setting each."""
    yield "tasks (sumo-dist list TASK: its cost terms, parameters and own settings):"
    tasks = list(tasks)
    width = max(len(task.name) for task in tasks) + 2
    for task in tasks:
        own = ", ".join(f"{name}={value}" for name, value in task.planner.items())
        about = " ".join(task.description.split())
        yield f"  {task.name:<{width}}{about}{f' ({own})' if own else ''}".rstrip()
    yield "\nplanner settings (--set NAME=VALUE; a task's own stand in brackets above):"
    yield f"  {'name':<16}{'default':>8}  what it is; what it may be"
    for name, value in asdict(PlannerConfig()).items():
        yield f"  {name:<16}{str(value) or '-':>8}  {SETTINGS[name].about}; {SETTINGS[name].valid}"
    yield f"\noptimizers: {', '.join(OPTIMIZERS)}"
    yield f"engines:    {', '.join(ENGINES)}"
