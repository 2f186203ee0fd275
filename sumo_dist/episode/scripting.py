"""What a script calls: an episode from start to end, and planning inside a loop of one's own."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import index
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np

from sumo_dist.episode.assemble import Episode, draw_start
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.episode.single import OnPlan, run_single
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.estimate.readings import Readings
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.provenance import cores
from sumo_dist.record.recording import Recording
from sumo_dist.rollout.interface import Rollouts
from sumo_dist.tasks import load_task
from sumo_dist.tasks.task import Task
from sumo_dist.timing import plan_due

Numbers = Mapping[str, float | Sequence[float]]
"""Weights or parameters by name."""


def run_episode(
    task: Task | str | Path,
    *,
    seed: int = 0,
    planner: Mapping[str, int | float | str] | None = None,
    weight: Numbers | None = None,
    param: Numbers | None = None,
    time_limit: float | None = None,
    threads: int | None = None,
    estimator: str = "truth",
    plant: str = "nominal",
    engine: str = "auto",
    on_plan: OnPlan = lambda _report: None,
) -> Recording:
    """Run one lockstep episode in this process, as `sumo-dist run --workers 0` does.

    Args:
        task: its name, the path of its file, or the task itself.
        seed: decides the start and all noise; the same seed gives the same bits.
        planner: settings by name in place of the task's and the defaults.
        weight: of cost terms by name, in place of the task's.
        param: the task's parameters by name.
        time_limit: robot time [s]; the task's own by default.
        threads: of the rollouts; by default one for each core.
        estimator: "truth" or "lowpass".
        plant: "nominal", "perturbed" or "hard".
        engine: kind of rollout engine, see `rollout.make_engine`.
        on_plan: called with the report of each plan.

    Returns:
        What happened; `ending` says how it ended, "success" if the task was achieved.

    Raises:
        UsageError: an argument is none of those that are valid, which the message names.
        KeyboardInterrupt: Ctrl-C.
    """
    found, config = configured(
        *(task, seed, planner, weight, param),
        time_limit=time_limit,
        estimator=estimator,
        plant=plant,
        engine=engine,
    )
    recording, ending = run_single(config, _threads(threads), on_plan, task=found)
    if ending.kind is End.INTERRUPTED:
        raise KeyboardInterrupt
    return recording


class MPC:
    """Plans for a robot that somebody else runs: states in, joint targets out, a tick at a time.

    A tick is 0.02 s of robot time and a plan is due every 2 or 3 of them. States are qpos then qvel
    of `model`: the robot's base and joints, then the objects. Close it when done, or use `with`.

    Attributes:
        task: what is to be done.
        model: the MuJoCo model that is planned on.
        tick: ticks so far.
        memory: (nm,) float32, of the low-level policy before this tick.
        plan_now: the plan that is followed, None before the first.
        report: the account of that plan: its candidates' costs, its terms, how long it took.
        recording: of all that was told and planned; `save` it and `sumo-dist replay` shows it.
    """

    def __init__(
        self,
        task: Task | str | Path,
        *,
        seed: int = 0,
        planner: Mapping[str, int | float | str] | None = None,
        weight: Numbers | None = None,
        param: Numbers | None = None,
        threads: int | None = None,
        engine: str = "auto",
    ) -> None:
        """Compile the task and load the policy; arguments are those of `run_episode`.

        Raises:
            UsageError: an argument is none of those that are valid, which the message names.
        """
        found, config = configured(task, seed, planner, weight, param, engine=engine)
        self._body, self._began = _Told(), time.perf_counter()
        self._episode = Episode.assemble(config, self._body, found)
        self._planning = LocalPlanning(self._episode.problem, config, _threads(threads))
        self.task, self.model = found, self._episode.problem.model
        self.memory = self._episode.controller.initial_memory()
        self.plan_now: Plan | None = None
        self.report: PlanReport | None = None
        self.recording = self._episode.recording

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the threads of the rollouts."""
        self._planning.__exit__()

    @property
    def tick(self) -> int:
        """Ticks so far."""
        return self._body.tick

    def start(self, seed: int = 0) -> np.ndarray:
        """Draw a state (nq + nv,) that an episode of the task may start from."""
        return draw_start(self.task, _whole("seed", seed), self._episode.controls.cost.parameters)

    def plan(self, state: np.ndarray) -> PlanReport:
        """Make a plan from a state (nq + nv,) of this tick, to be followed from now on.

        Returns:
            The plan, `.plan.knots` (K, n), with its candidates' `.costs` (B,) and `.terms`.
        """
        state = state_of(self.model, state)
        number = 0 if self.plan_now is None else self.plan_now.number + 1
        request = self._episode.request(number, self.tick, state, self.memory, self.plan_now)
        report = self._planning(request, self._episode.controls.planner)
        self.recording.add_traces(self._planning.traces)
        self.recording.add_plan(report)
        self.plan_now, self.report = report.plan, report
        return report

    def step(self, state: np.ndarray) -> np.ndarray:
        """Let a tick pass: plan if a plan is due, and follow it.

        Args:
            state: (nq + nv,) at the beginning of the tick.

        Returns:
            Joint targets (nu,) [rad] for the servos until the next tick, within the robot's limits.

        Raises:
            SumoError: the policy's joint targets are not finite.
        """
        state = state_of(self.model, state)
        self._episode.note_tick(state, self.memory)
        planned = self.plan_now is not None and self.plan_now.tick == self.tick
        due = plan_due(self.tick, self._episode.controls.planner.rate) is not None
        if self.plan_now is None or (due and not planned):
            self.plan(state)
        assert self.plan_now is not None, "it was made just now"
        action = self.plan_now.at(np.array([self.tick]))[0]
        targets, self.memory = self._episode.follow(action, state, self.memory)
        if not self._episode.guard.send(targets):
            raise SumoError(f"the policy's joint targets are not finite at tick {self.tick}")
        self._body.advance()
        return self._body.targets

    def ending(self, state: np.ndarray) -> str:
        """Say whether an episode of the task ends in this tick's state; ask once a tick.

        Returns:
            "success", "fell", "timeout", or one of the task's failures; "" while it goes on.
        """
        state = state_of(self.model, state)
        verdict = self._episode.verdict(self.tick, state)
        if verdict is None:
            return ""
        self._episode.note_tick(state, self.memory)
        return self._episode.finish(verdict, self._began).reason

    def roll_out(self, state: np.ndarray, commands: np.ndarray) -> Rollouts:
        """Roll out commands of the low-level policy, with the policy inside.

        Args:
            state: (nq + nv,) from which all rows start, with this tick's `memory`.
            commands: (B, T, nc), a command a tick; `task.actions.commands` makes them of actions.
        """
        return self._planning.engine.rollout(state_of(self.model, state), self.memory, commands)

    def evaluate(self, state: np.ndarray, knots: np.ndarray) -> Evaluation:
        """Roll out candidates of one's own, knots (B, K, n) in [-1, 1], and cost them.

        Of a smooth spline the first two knots are the actions of a tick ago and of now. The
        evaluation has each candidate's terms; `.costs(weights)` are its total costs (B,).
        """
        parameters = self._episode.controls.cost.parameters
        return self._planning.evaluator(state_of(self.model, state), self.memory, parameters, knots)

    @property
    def weights(self) -> np.ndarray:
        """Weights of the cost terms, (n_terms,), in the order of `task.cost`."""
        return self._episode.controls.cost.weights


def state_of(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """Return a copy of what a caller gives as a state (nq + nv,) of a model.

    Raises:
        UsageError: it is none.
    """
    size = model.nq + model.nv
    try:
        numbers = np.array(state, np.float64)
    except (TypeError, ValueError):
        raise UsageError(f"state must be ({size},) numbers, got {state!r}") from None
    if numbers.shape != (size,) or not np.isfinite(numbers).all():
        raise UsageError(
            f"state must be ({size},) finite numbers, {model.nq} of qpos and {model.nv} of qvel, "
            f"got shape {numbers.shape}"
        )
    return numbers


@dataclass
class _Told:
    """The body of an `MPC`: another loop tells its states and takes its joint targets."""

    tick: int = 0
    truth: np.ndarray | None = None
    targets: np.ndarray = field(default_factory=lambda: np.empty(0))
    can_hold: bool = True

    def read(self) -> Readings:
        """Refuse: there are no sensors."""
        raise SumoError("this body's states are told, not read")

    def send(self, targets: np.ndarray) -> None:
        """Keep the joint targets of this tick."""
        self.targets = targets.copy()

    def advance(self) -> None:
        """Let the tick pass."""
        self.tick += 1


def configured(
    task: Task | str | Path,
    seed: int,
    planner: Mapping[str, Any] | None,
    weight: Numbers | None,
    param: Numbers | None,
    **fields: Any,
) -> tuple[Task, EpisodeConfig]:
    """Return the task and what decides its episode, checked."""
    if not isinstance(task, Task | str | Path):
        raise UsageError(f"task must be a Task, a name or the path of a task file, got {task!r}")
    found = task if isinstance(task, Task) else load_task(str(task))
    settings = dict(_mapping("planner", planner))
    start = PlannerConfig.resolve(found.planner, optimizer=settings.pop("optimizer", None))
    config = EpisodeConfig(
        found.source or found.name,
        _whole("seed", seed),
        start.changed(settings),
        weight=_texts("weight", weight),
        param=_texts("param", param),
        **fields,
    )
    config.cost(found)
    found.check_settings(config.planner)
    return found, config


def _mapping(what: str, given: Mapping[str, Any] | None) -> Mapping[str, Any]:
    if given is not None and not isinstance(given, Mapping):
        raise UsageError(f"{what} must be values by name, such as {{...: ...}}, got {given!r}")
    return given or {}


def _texts(what: str, given: Numbers | None) -> tuple[str, ...]:
    """Return numbers by name as an `EpisodeConfig` has them, to the last bit."""
    texts = []
    for name, value in _mapping(what, given).items():
        try:
            numbers = np.atleast_1d(np.asarray(value, np.float64))
        except (TypeError, ValueError):
            raise UsageError(
                f"{what} {name!r} must be a number or several, got {value!r}"
            ) from None
        texts.append(f"{name}={','.join(map(repr, numbers.tolist()))}")
    return tuple(texts)


def _threads(threads: int | None) -> int:
    return cores() if threads is None else _whole("threads", threads)


def _whole(what: str, number: int) -> int:
    try:
        return index(number)
    except TypeError:
        raise UsageError(f"{what} must be a whole number, got {number!r}") from None
