"""What an operator may tell a robot while it works, and what comes of it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, Protocol

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End, Ending
from sumo_dist.errors import Interrupted, SumoError, UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task
from sumo_dist.tasks.task import Task

Verb = Literal[
    "pause", "resume", "step", "reset", "task", "weight", "parameter", "planner", "stop", "stand"
]

PAUSED_WAIT_S = 0.05  # how long a paused episode waits for the next command before it looks again


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        number: counted by the sender: one that comes twice is carried out once.
        sender: who gives it.
        verb: what to do. "pause", "resume" and "step" hold, release and advance time; "reset" and
            "task" begin another episode; "weight", "parameter" and "planner" change numbers from
            the next plan on; "stop" makes the robot sit down, "stand" lets it go on.
        name: of a term, parameter, planner setting or task.
        value: of what is named; ticks of a step; a seed of a reset or task; the reason of a stop.
    """

    number: int
    sender: str
    verb: Verb
    name: str = ""
    value: str = ""


class Operator(Protocol):
    """Whoever gives commands."""

    def take(self, tick: int, wait: float) -> Sequence[Command]:
        """Return the commands that have come by a tick, waiting up to `wait` [s] for one."""
        ...

    def answer(self, command: Command, tick: int, refusal: str) -> None:
        """Tell the sender that a command was carried out at a tick, or why not."""
        ...


class Nobody:
    """Nobody gives commands."""

    def take(self, tick: int, wait: float) -> Sequence[Command]:
        """Return none."""
        del tick, wait
        return ()

    def answer(self, command: Command, tick: int, refusal: str) -> None:
        """Do nothing."""


class Controls:
    """What of an episode may change while it runs.

    Attributes:
        planner, cost: planner settings, weights and parameters of the next plan.
        paused: no tick passes, but for steps.
        following: the episode that replaces this one, once one was asked for.
        commands: what was carried out, with the tick, as a recording keeps it.
    """

    def __init__(self, config: EpisodeConfig, task: Task, can_hold: bool = True) -> None:
        """Start as configured; a body that `can_hold` stands still in time while it is paused."""
        self._config, self._task, self._can_hold = config, task, can_hold
        self.planner, self.cost = config.planner, config.cost(task)
        self.paused, self._steps = False, 0
        self.following: EpisodeConfig | None = None
        self.commands: list[dict[str, Any]] = []

    def operate(self, operator: Operator, tick: int) -> Ending | None:
        """Carry out what was commanded by a tick, and wait while paused; return an end, if any."""
        while True:
            wait, end = PAUSED_WAIT_S if self._holds else 0.0, None
            for command in sorted(operator.take(tick, wait), key=lambda c: c.verb != "stop"):
                if end is not None:
                    late = "" if command.verb == "stop" else f"the episode ends: {end.reason}"
                    operator.answer(command, tick, late)
                elif command.verb == "stop":
                    self._note(command, tick)
                    operator.answer(command, tick, "")
                    end = stopped(command)
                else:
                    operator.answer(command, tick, self.apply(command, tick))
                    if self.following is not None:
                        end = Ending(End.REPLACED, f"{command.verb} by {command.sender}")
            if end is not None:
                return end
            if not self._holds:
                self._steps -= self.paused
                return None

    def apply(self, command: Command, tick: int) -> str:
        """Carry out a command other than "stop"; return why it is refused, "" if it is not."""
        try:
            self._apply(command)
        except SumoError as error:
            return str(error)
        self._note(command, tick)
        return ""

    @property
    def _holds(self) -> bool:
        return self.paused and self._steps == 0

    def _note(self, command: Command, tick: int) -> None:
        self.commands.append({"tick": tick, **asdict(command)})

    def _apply(self, command: Command) -> None:
        name, value, table = command.name, command.value, self._task.table
        match command.verb:
            case "pause" | "resume" | "step":
                self._hold(command.verb, value)
            case "weight":
                self.cost = table.adjusted([f"{name}={value}"], [], self.cost)
            case "parameter":
                self.cost = table.adjusted([], [f"{name}={value}"], self.cost)
            case "planner":
                planner = self.planner.steered([f"{name}={value}"])
                self._task.check_settings(planner)
                self.planner = planner
            case "reset":
                self.following = self._next(self._config.task, value)
            case "task":
                task = load_task(name)
                self._check_robot(task)
                planner = self._planner_of(task)
                task.check_settings(planner)
                problem = Problem.build(task, planning_options(planner))
                problem.engine(1, self._config.engine).close()  # else the next episode says why not
                following = replace(self._next(name, value), weight=(), param=())
                self.following = replace(following, planner=planner)
            case "stand" | "stop":  # it stands; a stop never comes here
                pass

    def _check_robot(self, task: Task) -> None:
        robot, wanted = self._task.scene.robot.name, task.scene.robot.name
        if wanted != robot:
            raise UsageError(f"task {task.name!r} is one for {wanted}, this robot is {robot}")

    def _planner_of(self, task: Task) -> PlannerConfig:
        """Return the settings of another task: its own, but for what was asked for in this one."""
        usual = asdict(PlannerConfig.resolve(self._task.planner))
        asked = {k: v for k, v in asdict(self.planner).items() if v != usual[k]}
        return PlannerConfig.resolve({**task.planner, **asked})

    def _hold(self, verb: Verb, value: str) -> None:
        if verb == "step":
            if not self.paused:
                raise UsageError("pause first: a step is of a robot that is paused")
            self._steps += _whole("step", value or "1", 1, 10_000)
            return
        if verb == "pause" and not self._can_hold:
            raise UsageError("this robot's time cannot be held; stop it instead")
        self.paused, self._steps = verb == "pause", 0

    def _next(self, task: str, seed: str) -> EpisodeConfig:
        number = _whole("seed", seed, 0, 2**63 - 1) if seed else self._config.seed
        weight, param = self._task.table.texts(self.cost)
        return replace(
            self._config, task=task, seed=number, planner=self.planner, weight=weight, param=param
        )


def stopped(command: Command) -> Ending:
    """Return the end that a "stop" makes."""
    by = f"{command.sender}: {command.value}" if command.value else command.sender
    return Ending(End.STOPPED, by)


def _whole(what: str, text: str, low: int, high: int) -> int:
    try:
        number = int(text)
    except ValueError:
        number = low - 1
    if not low <= number <= high:
        raise UsageError(f"{what} must be a whole number from {low} to {high}, got {text!r}")
    return number


class Repeater:
    """Gives the commands of a recorded episode again, each at its tick."""

    def __init__(self, commands: Sequence[dict[str, Any]], last_tick: int | None = None) -> None:
        """Repeat commands as `Controls.commands` has them.

        Args:
            commands: of the recording.
            last_tick: in which the recorded episode was interrupted; None if it ended by itself.
        """
        self._left = [(c["tick"], _command(c)) for c in commands]
        self._last_tick = last_tick

    def take(self, tick: int, wait: float) -> Sequence[Command]:
        """Return the commands of a tick.

        Raises:
            Interrupted: the recorded episode was, in its last tick or waiting in it.
        """
        due = [command for t, command in self._left if t == tick]
        self._left = [(t, command) for t, command in self._left if t != tick]
        last = self._last_tick
        if not due and last is not None and (tick > last or (wait > 0 and tick == last)):
            raise Interrupted("as it was when it was recorded")
        return due

    def answer(self, command: Command, tick: int, refusal: str) -> None:
        """Raise if a command that was carried out is refused now."""
        if refusal:
            raise SumoError(
                f"tick {tick}: {command.verb}, carried out before, is refused: {refusal}"
            )


def _command(record: dict[str, Any]) -> Command:
    return Command(**{key: value for key, value in record.items() if key != "tick"})
