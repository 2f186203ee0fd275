"""Owns the robot: follows the plan at robot time, runs the policy at 50 Hz, sends joint targets.

It owns the episode, too, and tells all other services which one it is. A reset or another task is
another episode of the same session: nothing is started again.
"""

import threading
import time
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End, Ending, fault, unforeseen
from sumo_dist.episode.lockstep import run_lockstep
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.realtime import Pace, RealtimeLoop, calibrate, guarded
from sumo_dist.episode.safety import sit_down
from sumo_dist.episode.summary import keep
from sumo_dist.errors import Interrupted, Stopped, SumoError
from sumo_dist.planner.report import PlanReport
from sumo_dist.priority import goes_first
from sumo_dist.record.folders import by_hand, episode_folder
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import Connection
from sumo_dist.wire.events import Tell, teller
from sumo_dist.wire.health import Counters, Heartbeat
from sumo_dist.wire.keys import Member
from sumo_dist.wire.messages import EpisodeInfo


@dataclass(frozen=True, kw_only=True)
class RobotOptions(Connection):
    """A robot, here a simulated one.

    Attributes:
        episode: what to do first.
        connect: the router's endpoint.
        keys: folder from `sumo-dist keys host`, for an endpoint with TLS.
        robot: its name on the bus.
        out: folder for run.npz and summary.json, by default a new one below runs/; later episodes
            of the session have their files in episode-2 and so on below it.
        speed: of the realtime clock, robot time per wall time; None fits it to the planner.
        wait: how long to wait for an answer before giving up [s].
        resume_wait: how long a robot that has stopped in realtime waits to be told to stand
            before the episode ends [s].
        stay: after an episode has ended, wait for a reset or another task until interrupted.
    """

    role: ClassVar[str] = "robot"

    episode: EpisodeConfig
    out: Path | None = None
    speed: float | None = None
    wait: float = 30.0
    resume_wait: float = 0.0
    stay: bool = False


def run(options: RobotOptions, stop: threading.Event) -> int:
    """Run episodes, write their recordings and summaries, return the last one's exit code."""
    with options.dial(run=uuid.uuid4().hex[:12]) as bus:
        return Session(options, bus, stop).run()


class Session:
    """A robot on the bus, from its first episode to its last."""

    def __init__(self, options: RobotOptions, bus: Bus, stop: threading.Event) -> None:
        """Speak on a bus until told to stop."""
        self._options, self._bus, self._stop = options, bus, stop
        self._id = bus.run or ""
        self._tell: Tell = teller(bus, "robot")
        self._speed = options.speed
        self._optimizers: set[str] = set()
        self._progress = Progress((), lambda line: self._tell("info", line))
        self._link = RobotLink(bus, options.wait, stop, self._tell, self._on_plan)
        self._episode: Episode | None = None
        self._loop: RealtimeLoop | None = None
        self._mode = "waiting"
        self._began = 0.0  # time.perf_counter() of the episode's start, in realtime of its clock's

    def run(self) -> int:
        """Return the exit code."""
        self._claim_the_name()
        config: EpisodeConfig | None = self._options.episode
        number, code = 0, 0
        with Heartbeat(self._bus, "robot", self.health, self._link.announce):
            while config is not None:
                number += 1
                try:
                    ending, config = self._play(config, number)
                except SumoError as error:
                    if number == 1:
                        raise
                    self._tell("error", f"the next episode cannot begin: {error}")
                    return fault(error).exit_code
                code = ending.exit_code
        return code

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        mode = self._loop.mode if self._loop else self._mode
        if self._episode is not None and mode == "running" and self._episode.controls.paused:
            mode = "paused"
        slipped = round(self._loop.slipped_s, 2) if self._loop else 0.0
        counters: dict[str, int | float | str] = {"refused": self._link.refused}
        if self._episode is not None:
            counters |= {"tick": self._episode.body.tick, "slipped s": slipped}
            counters |= self._episode.guard.account()
        return mode, counters

    def _claim_the_name(self) -> None:
        """Be the robot of this name, or say who is.

        Raises:
            SumoError: another robot has the name.
        """
        robots = self._bus.watch("robot", self._on_robot)
        self._bus.watch("optimizer", self._on_optimizer)
        if not robots.vacant():
            raise SumoError(
                f"a robot named {self._options.robot!r} is at {self._options.connect} already: "
                "end it, or give this one another --robot or another router"
            )
        self._bus.announce("robot", self._id)

    def _on_robot(self, member: Member, alive: bool) -> None:
        if alive and member.id != self._id and self._episode is not None:
            self._tell("error", f"a second robot named {self._options.robot!r} has come")

    def _on_optimizer(self, member: Member, alive: bool) -> None:
        (self._optimizers.add if alive else self._optimizers.discard)(member.id)
        if len(self._optimizers) > 1:
            names = ", ".join(sorted(self._optimizers))
            self._tell("warning", f"{len(self._optimizers)} optimizers plan for it: {names}")

    def _on_plan(self, report: PlanReport) -> None:
        self._progress(report)

    def _play(self, config: EpisodeConfig, number: int) -> tuple[Ending, EpisodeConfig | None]:
        """Run an episode; return how it ended and what follows it."""
        run = f"{self._id}.{number}"
        out = episode_folder(self._options.out or by_hand(run), number)
        self._episode = episode = Episode.assemble(config)
        self._progress = Progress(
            episode.problem.task.table.terms, lambda line: self._tell("info", line)
        )
        info = EpisodeInfo(run, config.to_json(), episode.problem.hash, number)
        self._link.enter(episode, info)
        self._began = time.perf_counter()
        ending = self._guarded(episode)
        ending = episode.finish(ending, self._began)
        keep(episode.recording, ending, out)
        following = episode.controls.following
        stays = self._options.stay and ending.kind is not End.INTERRUPTED
        last = following is None and not stays
        self._link.end(episode.body.tick, ending.reason, ending.success, last)
        if following is None and stays:
            following = self._await_another(episode, ending)
        self._loop, self._mode = None, "waiting"
        return ending, following

    def _guarded(self, episode: Episode) -> Ending:
        """Run an episode; whatever goes wrong is its end, and this process goes on."""
        try:
            if episode.config.clock == "realtime":
                return self._realtime(episode)
            self._mode = "running"
            ending = run_lockstep(
                episode, self._link.ask_state, self._link.ask_plan, self._link.operator
            )
        except Interrupted:
            return Ending(End.INTERRUPTED)
        except Exception as error:  # it is the end of an episode, not of this process
            return unforeseen(error)
        if ending.kind is End.STOPPED:
            self._mode = "stopped"
            return sit_down(episode, ending)
        return ending

    def _realtime(self, episode: Episode) -> Ending:
        """Run against the wall clock, once everybody is there."""
        try:
            state = self._link.ask_state(episode.body.read())
            fitting = calibrate(episode, state, self._link)
        except Stopped:
            end = episode.controls.operate(self._link.operator, episode.body.tick)
            return sit_down(episode, end or fault("stopped"))
        self._speed = self._speed or fitting
        priority = "real-time" if goes_first() else "normal"
        self._tell("info", f"realtime at {self._speed:.3f} of the wall clock, {priority} priority")
        self._loop = RealtimeLoop(
            episode,
            self._link,
            self._link.operator,
            Pace(self._speed, self._options.resume_wait),
            self._stop,
            self._tell,
        )
        self._began = time.perf_counter()
        return guarded(self._loop, episode)

    def _await_another(self, episode: Episode, ending: Ending) -> EpisodeConfig | None:
        """Wait for a command that begins another episode; None if told to end.

        What is set meanwhile is the next one's.
        """
        self._tell("info", f"the episode has ended: {ending.reason}; waiting for a reset or a task")
        self._mode, operator = "ended", self._link.operator
        later = episode.body.tick + 1  # no part of what replay plans again of this episode
        while not self._stop.is_set():
            for command in operator.take(episode.body.tick, 0.0):
                refusal = "the episode has ended: reset, or give a task"
                if command.verb in ("reset", "task", "weight", "parameter", "planner"):
                    refusal = episode.controls.apply(command, later)
                operator.answer(command, later, refusal)
                if episode.controls.following is not None:
                    return episode.controls.following
            self._stop.wait(0.05)
        return None
