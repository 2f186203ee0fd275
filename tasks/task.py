"""What a task is: a scene, an action space, a table of costs, and how it starts and ends."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from sumo_dist.costs.terms import CostTerm
from sumo_dist.costs.view import View
from sumo_dist.errors import UsageError
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.tasks.reset import Start

Predicate = Callable[[View], np.ndarray]
"""View -> (B, T) bool."""


@dataclass(frozen=True)
class Task:
    """The optimal-control problem min_a sum_i w_i c_i(s, a) and the episode around it.

    Attributes:
        name: "<robot>/<task>".
        scene: the robot, the objects and the floor.
        actions: what the planner searches over, and g(a).
        frames: the named frames that cost and success functions see; "base" is the robot's.
        cost: the table of terms.
        reset: draws a start; see tasks.reset.
        success: when the task is solved.
        goal: where the object should come to rest, world [m], drawn by the viewer; None: anywhere.
        failure: what an episode that runs out of time may be put down to, the first that holds.
            It does not end the episode: what tips may be set up again.
        success_hold: how long success must hold without a break [s].
        time_limit: robot time after which the episode ends [s].
        trails: frames whose paths are traced in rollouts.
        source: what `load_task` finds the task by: its name, or the absolute path of its file.
    """

    name: str
    scene: Scene
    actions: ActionSpace
    frames: Mapping[str, FrameRef]
    cost: tuple[CostTerm, ...]
    reset: Callable[[np.random.Generator, Start], np.ndarray]
    success: Predicate
    goal: tuple[float, float, float] | None = None
    failure: Mapping[str, Predicate] = field(default_factory=dict)
    success_hold: float = 0.0
    time_limit: float = 30.0
    trails: tuple[str, ...] = ("gripper", "object")
    source: str = ""

    def __post_init__(self) -> None:
        names = [term.name for term in self.cost]
        if not names or len(set(names)) != len(names):
            raise UsageError(f"task {self.name!r}: cost terms need distinct names, got {names}")
        if missing := {"base", *self.trails} - set(self.frames):
            raise UsageError(f"task {self.name!r}: frames lack {sorted(missing)}")

    def __str__(self) -> str:
        """Return the task's cost table."""
        rows = [f"{term.name:<14}{term.weight:>10g}  {term.reduction}" for term in self.cost]
        return "\n".join([self.name, f"{'cost term':<14}{'weight':>10}  over the rollout", *rows])
