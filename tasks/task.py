"""What a task is: a scene, an action space, a table of costs, and how it starts and ends."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from sumo_dist.costs.fields import checked_name, checked_number
from sumo_dist.costs.parameters import Parameter, Parameters
from sumo_dist.costs.table import CostTable
from sumo_dist.costs.terms import CostTerm
from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.scene import Scene
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.tasks.fields import check_frames, check_functions, check_terms, check_times
from sumo_dist.tasks.reset import Start
from sumo_dist.tasks.terms import Predicate

ControllerName = Literal["policy", "joint-targets"]


@dataclass(frozen=True)
class Goal:
    """Where a frame should come to rest: at the task's parameter `goal` (x, y).

    Attributes:
        frame: of the task.
        z: height [m].
    """

    frame: str
    z: float


@dataclass(frozen=True)
class Task:
    """The optimal-control problem min_a sum_i w_i c_i(s, a) and the episode around it.

    Attributes:
        name: "<robot>/<task>".
        scene: the robot, the objects and the floor.
        actions: what the planner searches over, and g(a).
        frames: the named frames that residuals and success tests see; "base" is the robot's, and
            is there without being named.
        cost: the table of terms.
        reset: draws a start; see tasks.reset.
        success: when the task is solved.
        parameters: numbers that residuals, reset and success read as `r.p.name`.
        goal: where something should come to rest, drawn by the viewer: `Goal`, or a fixed place in
            the world [m] for what the task moves; None: anywhere.
        failure: what an episode that runs out of time may be put down to, the first that holds.
            It does not end the episode: what tips may be set up again.
        success_hold: how long success must hold without a break [s].
        time_limit: robot time after which the episode ends [s].
        trails: frames whose paths are traced in rollouts; by default the gripper, if the task
            names one, and what it moves.
        controller: what turns commands into joint targets inside rollouts and on the robot:
            "policy", the robot's low-level policy, or "joint-targets", none: the action space's
            commands are joint targets that the servos hold.
        planner: settings of the planner that the task needs, by name, such as {"horizon": 2.5};
            all others are the defaults, and whoever runs it may change any.
        description: what the robot does, in one line.
        source: what `load_task` finds the task by: its name, or the absolute path of its file.
    """

    name: str
    scene: Scene
    actions: ActionSpace
    frames: Mapping[str, FrameRef]
    cost: tuple[CostTerm, ...]
    reset: Callable[[np.random.Generator, Start], np.ndarray]
    success: Predicate
    parameters: tuple[Parameter, ...] = ()
    goal: Goal | tuple[float, float, float] | None = None
    failure: Mapping[str, Predicate] = field(default_factory=dict)
    success_hold: float = 0.0
    time_limit: float = 30.0
    trails: tuple[str, ...] = ()
    controller: ControllerName = "policy"
    planner: Mapping[str, int | float | str] = field(default_factory=dict)
    description: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        what = f"task {checked_name('a task', self.name)!r}"
        if not isinstance(self.scene, Scene) or not isinstance(self.actions, ActionSpace):
            raise UsageError(f"{what}: scene must be a Scene, and actions an ActionSpace")
        check_terms(what, self.cost)
        check_frames(what, self.frames)
        check_functions(what, self.reset, self.success, self.failure)
        check_times(what, self.success_hold, self.time_limit)
        base = FrameRef("body", self.scene.robot.base)
        object.__setattr__(self, "frames", {"base": base, **self.frames})
        if not self.trails:
            gripper = ("gripper",) if "gripper" in self.frames else ()
            object.__setattr__(self, "trails", (*gripper, *self.movers) or ("base",))
        if missing := {*self.trails} - set(self.frames):
            raise UsageError(f"{what}: frames lack {sorted(missing)}, which trails name")
        if self.controller not in get_args(ControllerName):
            raise unknown("controller", self.controller, get_args(ControllerName))
        _ = self.table  # which checks the parameters
        self._check_goal(what)
        self._check_planner(what)

    def _check_goal(self, what: str) -> None:
        if isinstance(self.goal, Goal):
            checked_number(f"{what}: z of its Goal", self.goal.z)
            if self.goal.frame not in self.frames:
                raise unknown("frame of the goal", self.goal.frame, self.frames)
            if "goal" not in self.table.parameters or self.table.parameters["goal"].size != 2:
                raise UsageError(f"{what}: its Goal needs a parameter `goal` of (x, y)")
        elif self.goal is not None:
            if np.shape(self.goal) != (3,):
                raise UsageError(f"{what}: goal must be (x, y, z), got {self.goal}")
            for axis, value in zip("xyz", self.goal, strict=True):
                checked_number(f"{what}: {axis} of its goal", value)

    def _check_planner(self, what: str) -> None:
        if not isinstance(self.planner, Mapping):
            raise UsageError(
                f"{what}: planner must be settings by name, such as "
                f'{{"horizon": 2.5}}, got {self.planner!r}'
            )
        try:
            self.check_settings(PlannerConfig.resolve(self.planner))
        except UsageError as error:
            raise UsageError(f"{what}: planner: {error}") from None

    def check_settings(self, settings: PlannerConfig) -> None:
        """See that the task has what the planner's settings ask of it.

        Raises:
            UsageError: they ask for guidance by the object, and it has none with a goal, or no
                such base.
        """
        if settings.guidance != "object":  # what a learned policy needs its contract says
            return
        why = ""
        if self.goal is None:
            why = "it has no goal"
        elif not self.goal_object:
            why = f"its goal is for {self.goal_frame!r}, which is no object that moves freely"
        elif self.actions.base.sum() != 3:
            why = "its actions do not search the base's velocities x, y and yaw"
        if why:
            raise UsageError(
                f"guidance={settings.guidance} is not for task {self.name!r}: {why}; "
                "valid here: guidance=none"
            )

    @cached_property
    def table(self) -> CostTable:
        """Weights and parameters: names, defaults and what they may be."""
        return CostTable(self.cost, self.parameters)

    @cached_property
    def movers(self) -> tuple[str, ...]:
        """The frames of the scene's objects: of each, the first that is its root body."""
        roots = {FrameRef("body", thing.name): "" for thing in self.scene.objects}
        for name, ref in self.frames.items():
            if roots.get(ref) == "":
                roots[ref] = name
        return tuple(filter(None, roots.values()))

    @property
    def goal_frame(self) -> str:
        """The frame that should come to the goal, if there is one."""
        if isinstance(self.goal, Goal):
            return self.goal.frame
        return next(iter(self.movers), "base")

    @property
    def goal_object(self) -> str:
        """The object of the scene that should come to the goal, "" if it is none of them."""
        element = self.frames[self.goal_frame].name if self.goal is not None else ""
        names = [thing.name for thing in self.scene.objects]
        return next((n for n in names if element == n or element.startswith(f"{n}/")), "")

    def goal_position(self, p: Parameters) -> np.ndarray | None:
        """Where the goal is, (3,) world [m]; None if there is none."""
        return place_of(self.goal, p)

    def __str__(self) -> str:
        """Return the task's terms, parameters and planner settings."""
        rows = [f"{term.name:<14}{term.weight:>10g}  {term.reduction}" for term in self.cost]
        lines = [self.name, f"{'cost term':<14}{'weight':>10}  over the rollout", *rows]
        if self.parameters:
            lines.append(f"{'parameter':<16}{'default':>14}  from, to")
            lines += [_line(parameter) for parameter in self.parameters]
        if self.planner:
            settings = ", ".join(f"{name}={value}" for name, value in self.planner.items())
            lines.append(f"planner         {settings}")
        return "\n".join(lines)


def place_of(goal: Goal | tuple[float, ...] | None, p: Parameters) -> np.ndarray | None:
    """Where a task's goal is under some parameters, (3,) world [m]; None if there is none."""
    if isinstance(goal, Goal):
        return np.array([*np.atleast_1d(p.goal), goal.z])
    return None if goal is None else np.array(goal)


def _line(parameter: Parameter) -> str:
    default = ",".join(f"{x:g}" for x in parameter.checked(parameter.default))
    low, high = parameter.range
    return f"{parameter.name:<16}{default:>14}  {low:g}, {high:g} {parameter.unit}".rstrip()
