"""Distributed sampling-based MPC over the commands of pretrained whole-body policies.

What a script needs is here; docs/library.md describes it. A name is imported when it is first used,
so that importing the package itself costs nothing.
"""

TYPE_CHECKING = False  # type checkers know the name, and typing need not be imported
if TYPE_CHECKING:
    from sumo_dist.costs.parameters import Parameter as Parameter
    from sumo_dist.costs.terms import CostTerm as CostTerm
    from sumo_dist.episode.scripting import MPC as MPC
    from sumo_dist.episode.scripting import run_episode as run_episode
    from sumo_dist.errors import SumoError as SumoError
    from sumo_dist.errors import UsageError as UsageError
    from sumo_dist.model.frames import FrameRef as FrameRef
    from sumo_dist.model.scene import Scene as Scene
    from sumo_dist.model.scene import SceneObject as SceneObject
    from sumo_dist.plant.simulated import Plant as Plant
    from sumo_dist.record.recording import Recording as Recording
    from sumo_dist.tasks import load_task as load_task
    from sumo_dist.tasks import task_names as task_names
    from sumo_dist.tasks.reset import OnFloor as OnFloor
    from sumo_dist.tasks.reset import Reset as Reset
    from sumo_dist.tasks.task import Goal as Goal
    from sumo_dist.tasks.task import Task as Task
    from sumo_dist.view.inline import film as film
    from sumo_dist.view.show import show as show

__version__ = "0.1.0"

_HOMES = {
    "sumo_dist.costs.parameters": ("Parameter",),
    "sumo_dist.costs.terms": ("CostTerm",),
    "sumo_dist.episode.scripting": ("MPC", "run_episode"),
    "sumo_dist.errors": ("SumoError", "UsageError"),
    "sumo_dist.model.frames": ("FrameRef",),
    "sumo_dist.model.scene": ("Scene", "SceneObject"),
    "sumo_dist.plant.simulated": ("Plant",),
    "sumo_dist.record.recording": ("Recording",),
    "sumo_dist.tasks": ("load_task", "task_names"),
    "sumo_dist.tasks.reset": ("OnFloor", "Reset"),
    "sumo_dist.tasks.task": ("Goal", "Task"),
    "sumo_dist.view.inline": ("film",),
    "sumo_dist.view.show": ("show",),
}
_NAMES = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _NAMES:
        offered = ", ".join(sorted(_NAMES))
        raise AttributeError(f"module 'sumo_dist' has no attribute {name!r}; it offers: {offered}")
    from importlib import import_module

    value = getattr(import_module(_NAMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_NAMES})
