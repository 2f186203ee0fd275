"""A recorded lockstep episode again: as it was, or as it would have been with other numbers.

Neither needs more than the recording: a seed decides the start and all noise, and what the plant,
the estimator, the guard and the referee remember follows from the plans that were followed. So to
go on from an instant, the plans before it are taken from the recording and everything else is
computed again; the rollouts, which are nearly all of the work, begin at the instant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Command, Repeater, Verb
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End, Ending
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.episode.lockstep import MakePlan
from sumo_dist.episode.single import OnPlan, recorded, run_planned
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import TRACE_POINTS
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.record.reports import planner_at, report
from sumo_dist.record.world import changed_versions, unchanged_task
from sumo_dist.rollout import ENGINES, engine_identity
from sumo_dist.tasks.task import Task
from sumo_dist.timing import TICK

SENDER = "what-if"  # of the commands that change a future
_LAST_WORDS = ("stop", "reset", "task")  # commands that end an episode
_ASKED: dict[str, Verb] = {"weight": "weight", "param": "parameter", "set": "planner"}


@dataclass(frozen=True)
class Change:
    """What is other from an instant on.

    Attributes:
        tick: of the instant.
        weight, param, set: weights, parameters and planner settings as "name=value".
        seed: of the planner's noise; None leaves it.
        time_limit: of the whole episode [s]; None leaves it.
    """

    tick: int
    weight: tuple[str, ...] = ()
    param: tuple[str, ...] = ()
    set: tuple[str, ...] = ()
    seed: int | None = None
    time_limit: float | None = None

    @property
    def words(self) -> list[str]:
        """What is other, each as it would be asked for."""
        words = [f"{kind} {text}" for kind in _ASKED for text in getattr(self, kind)]
        words += [] if self.seed is None else [f"seed {self.seed}"]
        return words + ([] if self.time_limit is None else [f"time limit {self.time_limit:g} s"])

    def commands(self) -> list[Command]:
        """Return the commands of an operator who changes the numbers."""
        commands = list[Command]()
        asked = ((kind, text) for kind in _ASKED for text in getattr(self, kind))
        for number, (kind, text) in enumerate(asked):
            name, equals, value = text.partition("=")
            if not equals:
                raise UsageError(f"{kind} {text!r} is not of the form name=value")
            commands.append(Command(number, SENDER, _ASKED[kind], name, value))
        return commands


def repeat(
    recording: Recording, threads: int = 1, on_plan: OnPlan = lambda _report: None
) -> Recording:
    """Run a recorded lockstep episode again, with the commands that it was given.

    A plan that lost candidates with a worker is taken as it is: nobody knows which they were.

    Args:
        recording: of the episode.
        threads: of the rollouts.
        on_plan: is told of every plan that was made; what it raises ends the run.

    Raises:
        UsageError: it cannot be run again here, see `repeatable`.
    """
    config, task = repeatable(recording)
    last_tick = None if _ended_itself(recording) else len(recording.states) - 1
    partial = {
        int(n) for n, lost in zip(recording.plan_numbers, recording.lost, strict=True) if lost
    }
    operator = Repeater(recording.operator, last_tick)
    again, _ = _run(
        recording, (config, task), partial, _seeds(recording), operator, threads, on_plan
    )
    if last_tick is not None:  # it ended somewhere in its last tick
        again.cut(len(recording.states), len(recording.plan_numbers))
    return again


def what_if(
    recording: Recording, change: Change, threads: int = 1, on_plan: OnPlan = lambda _report: None
) -> tuple[Recording, Ending]:
    """Plan a recorded lockstep episode again from an instant on, with other numbers.

    What an operator said later is said again, unless it sets a number that the change sets; of a
    changed future, also not what ended the recorded one. The plant, its noise, the estimator, the
    guard, the policy and the referee are at the instant as they were, to the last bit.

    Returns:
        The whole episode, of which all before the instant is as recorded, and how it ended.

    Raises:
        UsageError: it cannot be run again here, the instant is not in it, or a number is none of
            those that the task and the planner have.
        SumoError: the episode did not come to the recorded state at the instant.
    """
    config, task = repeatable(recording)
    ticks = len(recording.states)
    if not 0 <= change.tick < ticks:
        valid = f"from 0 to {(ticks - 1) * TICK:g} s"
        raise UsageError(f"there is no {change.tick * TICK:g} s in this run; valid: {valid}")
    if change.time_limit is not None:
        if change.time_limit <= change.tick * TICK:
            now = change.tick * TICK
            raise UsageError(f"a time limit of {change.time_limit:g} s is over at {now:g} s")
        config = replace(config, time_limit=change.time_limit)
    operator, seeds = Repeater(_said(recording, change)), _seeds(recording, change)
    _check(recording, config, task, change)
    past = {
        int(number)
        for number, tick in zip(recording.plan_numbers, recording.plan_ticks, strict=True)
        if tick < change.tick
    }
    again, ending = _run(recording, (config, task), past, seeds, operator, threads, on_plan)
    again.config["seeds"] = seeds
    again.config["what_if"] = {
        "tick": change.tick,
        "changes": change.words,
        "plan_digest": recording.plan_digest,
        "state_digest": recording.state_digest,
    }
    _check_past(recording, again, change.tick)
    return again, ending


def repeatable(recording: Recording) -> tuple[EpisodeConfig, Task]:
    """Return the configuration with which an episode runs here as it ran, and its task.

    Raises:
        UsageError: it was a realtime episode, the recording is cut short, the task or the policy
            is another one now, or no engine here computes what the recording's did.
    """
    about = recording.config
    config = EpisodeConfig.of(about.get("episode"))
    if config.clock != "lockstep":
        raise UsageError(
            "this is a recording of a realtime run: when its plans came, nothing can repeat; only "
            "lockstep episodes repeat"
        )
    _check_whole(recording)
    if changed := changed_versions(recording, ("mujoco",)):
        raise UsageError(f"this run cannot be repeated here: {', '.join(changed)}")
    task = unchanged_task(recording)
    made = about["engine"], about.get("engine_build")
    for kind in (config.engine, *ENGINES):
        try:
            name, build = engine_identity(kind)
        except UsageError:  # it is not in this installation
            continue
        if name == made[0] and made[1] in (None, build):
            return replace(config, engine=kind), task
    here = engine_identity()
    raise UsageError(
        f"this run cannot be repeated here: engine {made[0]} (build {made[1] or 'unknown'}) made "
        f"it, and here is {here[0]} (build {here[1]}); another build or instruction set rounds "
        "otherwise"
    )


def _run(
    recording: Recording,
    about: tuple[EpisodeConfig, Task],
    taken: set[int],
    seeds: Sequence[tuple[int, int]],
    operator: Repeater,
    threads: int,
    on_plan: OnPlan,
) -> tuple[Recording, Ending]:
    """Run an episode; the plans of some numbers are taken from a recording, the others made."""
    config, task = about
    episode = Episode.assemble(config, task=task)
    with LocalPlanning(episode.problem, config, threads) as planning:
        plan = recorded(planning, episode.recording, on_plan)
        take = _taker(recording, episode.recording, task)

        def make_plan(request: PlanRequest, planner: PlannerConfig) -> PlanReport:
            if request.number in taken:
                return take(request, planner)
            planning.seed = next(
                (seed for tick, seed in reversed(seeds) if tick <= request.tick), config.seed
            )
            return plan(request, planner)

        return episode.recording, run_planned(episode, make_plan, operator)


def _taker(recording: Recording, again: Recording, task: Task) -> MakePlan:
    """Return what gives a recording's plans, with what only their maker knew, if it is there."""
    rows = {int(number): i for i, number in enumerate(recording.plan_numbers)}
    shape = len(task.trails), TRACE_POINTS, 3

    def take(request: PlanRequest, planner: PlannerConfig) -> PlanReport:
        i = rows[request.number]
        unseen = np.full((len(recording.costs[i]), *shape), np.nan, np.float32)
        again.add_traces(recording.traces[i] if recording.traces else unseen)
        again.plan_cpu_ms.append(recording.plan_cpu_ms[i] if recording.plan_cpu_ms else np.nan)
        return report(recording, i, planner)

    return take


def _seeds(recording: Recording, change: Change | None = None) -> list[tuple[int, int]]:
    """Seeds of the planner's noise other than the episode's, each with the tick it begins at."""
    seeds = [(int(tick), int(seed)) for tick, seed in recording.config.get("seeds", ())]
    if change is None or change.seed is None:
        return seeds
    return [
        *((tick, seed) for tick, seed in seeds if tick < change.tick),
        (change.tick, change.seed),
    ]


def _said(recording: Recording, change: Change) -> list[dict[str, Any]]:
    """Return what an operator says in a changed future, as a recording has it."""
    asked = change.commands()
    new = {(command.verb, command.name) for command in asked}
    before = [said for said in recording.operator if said["tick"] < change.tick]
    later = [
        said
        for said in recording.operator[len(before) :]
        if (said["verb"], said["name"]) not in new
        and not (change.words and said["verb"] in _LAST_WORDS)
    ]
    now = [{"tick": change.tick, **vars(command)} for command in asked]
    return [*before, *now, *later]


def _check(recording: Recording, config: EpisodeConfig, task: Task, change: Change) -> None:
    """Raise what is wrong with a change before anything is computed."""
    if change.seed is not None:
        replace(config, seed=change.seed)  # is it one?
    task.table.adjusted(change.weight, change.param)
    changed = planner_at(recording, change.tick).steered(change.set)
    task.check_settings(changed)


def _check_whole(recording: Recording) -> None:
    ticks, plans = len(recording.states), len(recording.plan_numbers)
    rows = {
        "estimates": (len(recording.estimates), ticks),
        "memories": (len(recording.memories), ticks),
        "knots": (len(recording.knots), plans),
        "costs": (len(recording.costs), plans),
        "plan ticks": (len(recording.plan_ticks), plans),
    }
    wrong = [
        f"{found} {name} of {right}" for name, (found, right) in rows.items() if found != right
    ]
    if plans and int(recording.plan_ticks[-1]) >= ticks:
        wrong.append(f"{ticks} states and a plan at tick {recording.plan_ticks[-1]}")
    if not ticks:
        wrong.append("no state")
    if wrong:
        raise UsageError(f"this recording is cut short: it has {', '.join(wrong)}")


def _check_past(recording: Recording, again: Recording, tick: int) -> None:
    """Raise unless an episode came to an instant as it was recorded."""
    for name in ("states", "estimates", "memories"):
        before, now = (np.array(getattr(each, name)[: tick + 1]) for each in (recording, again))
        if before.shape != now.shape or not np.array_equal(before, now):
            raise SumoError(
                f"the recorded plans do not lead to the recorded {name} at {tick * TICK:g} s: "
                "`sumo-dist replay RUN --verify` says from where on"
            )


def _ended_itself(recording: Recording) -> bool:
    """Whether the task or an operator ended an episode: all else comes from outside of it."""
    outside = (End.INTERRUPTED.value, End.FAULT.value)
    return bool(recording.ending) and not recording.ending.startswith(outside)
