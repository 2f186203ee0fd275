"""Owns the robot: follows the plan at robot time, runs the policy at 50 Hz, sends joint targets."""

import threading
import time
from dataclasses import dataclass
from pathlib import Path

from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.episode.assemble import make_guard, make_plant
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import Ending
from sumo_dist.episode.follow import misfit
from sumo_dist.episode.lockstep import run_lockstep
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.realtime import RealtimeLoop, calibrate
from sumo_dist.episode.referee import Referee
from sumo_dist.episode.safety import sitting_down
from sumo_dist.episode.summary import keep
from sumo_dist.errors import Interrupted, Stopped, SumoError
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.plant.simulated import Plant
from sumo_dist.priority import goes_first
from sumo_dist.record.recording import Recording
from sumo_dist.rollout import engine_identity, make_controller
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import Tell, teller
from sumo_dist.wire.health import Counters, Pulse
from sumo_dist.wire.keys import BY_HAND
from sumo_dist.wire.messages import RunEnd
from sumo_dist.wire.session import DEFAULT_ENDPOINT


@dataclass(frozen=True)
class RobotOptions:
    """A robot, here a simulated one.

    Attributes:
        episode: what to do.
        connect: the router's endpoint.
        robot: its name on the bus.
        run: id of the run.
        out: folder for run.npz and summary.json.
        speed: of the realtime clock, robot time per wall time; None fits it to the planner.
        wait: how long to wait for an answer before giving up [s].
        resume_wait: how long a robot that has stopped in realtime waits for `sumo-dist resume`
            before the run ends [s].
    """

    episode: EpisodeConfig
    connect: str = DEFAULT_ENDPOINT
    robot: str = "spot"
    run: str = BY_HAND
    out: Path = Path("runs", BY_HAND)
    speed: float | None = None
    wait: float = 30.0
    resume_wait: float = 0.0


def run(options: RobotOptions, stop: threading.Event) -> int:
    """Run one episode, write its recording and summary, return the exit code."""
    config = options.episode
    task = load_task(config.task)
    problem = Problem.build(task, planning_options(config.planner))
    recording = Recording(config.describe(problem, engine_identity(config.engine)[0]))
    with Bus.dial(options.connect, options.robot, run=options.run) as bus:
        tell = teller(bus, options.run, "robot")
        plant = make_plant(config, task)
        link = RobotLink(
            *(bus, options.run, options.wait, stop, tell),
            Progress(recording.config["terms"], lambda line: tell("info", line)),
            lambda plan: misfit(plan, task.actions, plant.tick),
            plant.model.nq + plant.model.nv,
        )
        body = _Body(options, problem, plant, link, recording, stop, tell)
        with Pulse(bus, options.run, "robot", body.health):
            bus.announce("robot", "main")
            began = time.monotonic()
            reason = body.run()
            wall = time.monotonic() - (body.began or began)
            for _ in range(3):  # messages may be dropped, and nobody answers this one
                end = RunEnd(options.run, body.plant.tick, reason, success=reason == "success")
                bus.publish(end)
                time.sleep(0.02)
    recording.commands = body.guard.account()
    ending = Ending(reason, wall)
    keep(recording, ending, options.out)
    return ending.exit_code


class _Body:
    """The robot and what it does in one episode."""

    def __init__(
        self,
        options: RobotOptions,
        problem: Problem,
        plant: Plant,
        link: RobotLink,
        recording: Recording,
        stop: threading.Event,
        tell: Tell,
    ) -> None:
        config, self._task = options.episode, problem.task
        self._options, self._link, self._recording = options, link, recording
        self._stop, self._tell = stop, tell
        self.plant = plant
        self.guard = make_guard(self._task, self.plant, recording)
        self._controller = make_controller(problem.policy, self.plant.model, config.engine)
        self._referee = Referee(self._task, self.plant.model, config.time_limit)
        self._loop: RealtimeLoop | None = None
        self.began: float | None = None  # time.monotonic() at which a realtime clock started
        self._mode = "waiting"

    def run(self) -> str:
        """Return how the episode ended."""
        try:
            return self._lockstep() if self._options.episode.clock == "lockstep" else self._race()
        except Interrupted:
            return "interrupted"
        except Stopped as order:
            self._sit_down()
            return f"{order}, the robot sat down"
        except SumoError as error:
            return f"fault: {error}"

    def health(self) -> tuple[str, Counters]:
        """How it is, for whoever watches."""
        mode = self._loop.mode if self._loop else self._mode
        slipped = round(self._loop.slipped_s, 2) if self._loop else 0.0
        counters = {"tick": self.plant.tick, "refused": self._link.refused, "slipped s": slipped}
        return mode, {**counters, **self.guard.account()}

    def _lockstep(self) -> str:
        self._mode = "running"
        return run_lockstep(
            *(self.plant, self.guard, self._controller, self._task.actions, self._referee),
            self._link.ask_state,
            lambda request: self._link.ask_plan(self.plant.read(), request),
            self._recording,
        )

    def _race(self) -> str:
        # With a given speed too: it waits until everybody is there.
        fitting = calibrate(self.plant, self._controller.initial_memory(), self._link)
        speed = self._options.speed or fitting
        priority = "real-time" if goes_first() else "normal"
        self._tell("info", f"realtime at {speed:.3f} of the wall clock, {priority} priority")
        self.began = time.monotonic()
        self._loop = RealtimeLoop(
            *(self.plant, self.guard, self._controller, self._task, self._referee, self._link),
            *(self._recording, speed, self._stop, self._tell, self._options.resume_wait),
        )
        return self._loop.run()

    def _sit_down(self) -> None:
        """Stop a robot that lets everybody wait: its clock does not run by itself."""
        self._mode = "stopped"
        memory = self._controller.initial_memory()
        for targets in sitting_down(self._task.scene.robot, self.guard.last):
            self.guard.send(targets)
            self._recording.add_tick(self.plant.state, self.plant.state, memory)
