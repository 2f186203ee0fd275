"""The world that a recording was made in: its compiled model, and its task as far as it is data.

A task's file and its objects' files may change, or go, after a run. So a recording carries what is
needed to show it: MuJoCo's own binary of the model, which is exact and some 20 kB when compressed.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, NoReturn, TypeVar

import mujoco
import numpy as np

from sumo_dist.costs.parameters import Parameter
from sumo_dist.costs.terms import CostTerm
from sumo_dist.costs.view import View
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import PLANT, Scene, SceneObject, compile_model
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.provenance import versions
from sumo_dist.record.recording import Recording
from sumo_dist.robots.robot import ActionSpace, Robot
from sumo_dist.robots.safety import Safety
from sumo_dist.tasks import load_task
from sumo_dist.tasks.task import Goal, Task

_FILE = "world.mjb"

T = TypeVar("T")


@dataclass(frozen=True)
class World:
    """What is shown of an episode.

    Attributes:
        model: of the scene, with all that is only seen.
        task: the recording's. Where its files have changed or gone since, it is what the recording
            has of it, which is everything but its functions: of its residuals and its success test
            nobody knows the values, which are nan, and it cannot be planned for.
    """

    model: mujoco.MjModel
    task: Task

    @classmethod
    def of(cls, recording: Recording) -> "World":
        """Return the world that a recording was made in.

        Raises:
            UsageError: it carries none, and its task is another one now; or another version of
                MuJoCo made it.
        """
        if not recording.model:
            task = unchanged_task(recording)
            return cls(compile_model(task.scene, PLANT), task)
        model = _model(recording)
        try:
            return cls(model, unchanged_task(recording))
        except UsageError:
            pass
        try:
            return cls(model, _described(recording.config["task"]))
        except (KeyError, TypeError, AttributeError) as error:
            raise UsageError(
                f"this recording's task cannot be read: {error!r}; sumo-dist "
                f"{recording.config['versions'].get('sumo-dist')} made it"
            ) from None


def _model(recording: Recording) -> mujoco.MjModel:
    made, here = recording.config["versions"]["mujoco"], versions()["mujoco"]
    if made != here:
        raise UsageError(
            f"this recording was made with MuJoCo {made}, which alone can read its model; here it "
            f"is {here}: pip install mujoco=={made}"
        )
    try:
        return mujoco.MjModel.from_binary_path(_FILE, {_FILE: recording.model})
    except ValueError as error:
        raise UsageError(f"this recording's model cannot be read: {error}") from None


def saved(model: mujoco.MjModel) -> bytes:
    """Return a model as a recording carries it."""
    binary = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    return binary.tobytes()


def unchanged_task(recording: Recording) -> Task:
    """Return the task that a recording was made of, functions and all.

    Raises:
        UsageError: it is not here any more, or it is another one now.
    """
    config = recording.config
    source = config["episode"]["task"]
    try:
        task = load_task(source)
        options = planning_options(PlannerConfig.from_settings(config["episode"]["planner"]))
        problem = Problem.build(task, options)
    except SumoError as error:
        raise UsageError(f"the task of this recording is not here as it was: {error}") from None
    if problem.hash != config["task_hash"]:
        then = config.get("hashes", {})
        parts = [_PARTS[name] for name, now in problem.hashes.items() if then.get(name, now) != now]
        what = f" ({'; '.join(parts)})" if parts else ""
        raise UsageError(
            f"{source} has changed since this run: its hash was {config['task_hash']} and is "
            f"{problem.hash} now{what}; bring back the task's files, and the sumo-dist of then "
            f"({config['versions']['sumo-dist']})"
        )
    return task


_PARTS = {
    "model": "another model: objects, robot or scene",
    "policy": "other weights of the low-level policy",
    "cost": "other cost terms, parameters, frames or actions",
    "episode": "another reset, success or failure test or time limit",
}


def changed_versions(recording: Recording, names: Sequence[str] = ()) -> list[str]:
    """Say which versions of what decides a run's bits were others, of some packages or of all."""
    made, here = recording.config["versions"], versions()
    return [
        f"{name} was {made[name]} and is {now} now"
        for name, now in here.items()
        if (not names or name in names) and made.get(name, now) != now
    ]


def description(task: Task) -> dict[str, Any]:
    """Return a task without its functions, as JSON has it."""
    actions = task.actions
    described = {
        "name": task.name,
        "robot": asdict(task.scene.robot),
        "objects": [thing.name for thing in task.scene.objects],
        "actions": {name: getattr(actions, name) for name in _ACTIONS},
        "frames": {name: asdict(ref) for name, ref in task.frames.items()},
        "cost": [{name: getattr(term, name) for name in _TERM} for term in task.cost],
        "parameters": [asdict(parameter) for parameter in task.parameters],
        "goal": asdict(task.goal) if isinstance(task.goal, Goal) else task.goal,
        **{name: getattr(task, name) for name in _PLAIN},
    }
    return json.loads(json.dumps(described, default=_plain))


def _plain(value: Any) -> Any:
    """Return numbers of another kind than Python's own as JSON has them, anything else as text."""
    try:
        return np.asarray(value, float).tolist()
    except (TypeError, ValueError):
        return repr(value)


_ACTIONS = ("names", "lower", "upper", "default", "velocities")
_TERM = ("name", "weight", "reduction")
_PLAIN = ("success_hold", "time_limit", "trails", "controller", "source")


def _described(described: Mapping[str, Any]) -> Task:
    """Return the task of a description, without functions."""
    robot, actions, goal = (described[name] for name in ("robot", "actions", "goal"))
    numbers = {name: np.array(actions[name], float) for name in ("lower", "upper", "default")}
    things = tuple(SceneObject(name, "") for name in described["objects"])
    return Task(
        name=described["name"],
        scene=Scene(_made(Robot, robot, safety=_made(Safety, robot["safety"])), things),
        actions=_made(ActionSpace, actions, **numbers, to_command=_absent),
        frames={name: _made(FrameRef, ref) for name, ref in described["frames"].items()},
        cost=tuple(_made(CostTerm, term, residual=_unknown) for term in described["cost"]),
        reset=_absent,
        success=_unknown,
        parameters=tuple(_made(Parameter, each) for each in described["parameters"]),
        goal=_made(Goal, goal) if isinstance(goal, dict) else _tupled(goal),
        **{name: _tupled(described[name]) for name in _PLAIN},
    )


def _made(kind: type[T], recorded: Mapping[str, Any], **instead: Any) -> T:
    """Return a dataclass of recorded values and others; what this version lacks is left out."""
    names = {f.name for f in fields(kind) if f.init}  # pyright: ignore[reportArgumentType]
    known = {name: _tupled(value) for name, value in recorded.items() if name in names}
    return kind(**{**known, **instead})


def _tupled(value: Any) -> Any:
    """Return a tuple of which JSON has made a list."""
    return tuple(value) if isinstance(value, list) else value


def _unknown(view: View) -> np.ndarray:
    return np.full(view.actions.shape[:2], np.nan)


def _absent(*_: object) -> NoReturn:
    raise SumoError("a recording carries no functions of its task")
