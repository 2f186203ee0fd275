"""Owns the robot: follows the plan at robot time, runs the policy at 50 Hz, sends joint targets."""

import threading
import time
from dataclasses import dataclass
from pathlib import Path

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.lockstep import run_lockstep
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.realtime import RealtimeLoop, calibrate
from sumo_dist.episode.referee import Referee
from sumo_dist.episode.start import make_plant
from sumo_dist.episode.summary import Ending, summarise, write_summary
from sumo_dist.errors import Interrupted, SumoError
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.record.recording import Recording
from sumo_dist.rollout import engine_identity, make_controller
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.events import teller
from sumo_dist.wire.keys import BY_HAND
from sumo_dist.wire.messages import RunEnd
from sumo_dist.wire.robot_link import RobotLink
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
    """

    episode: EpisodeConfig
    connect: str = DEFAULT_ENDPOINT
    robot: str = "spot"
    run: str = BY_HAND
    out: Path = Path("runs", BY_HAND)
    speed: float | None = None
    wait: float = 30.0


def run(options: RobotOptions, stop: threading.Event) -> int:
    """Run one episode, write its recording and summary, return the exit code."""
    config = options.episode
    task = load_task(config.task)
    problem = Problem.build(task, planning_options(config.planner))
    plant = make_plant(config, task)
    controller = make_controller(problem.policy, plant.model, config.engine)
    referee = Referee(task, plant.model, config.time_limit)
    recording = Recording(config.describe(problem, engine_identity(config.engine)[0]))
    with Bus.dial(options.connect, options.robot, run=options.run) as bus:
        tell = teller(bus, options.run, "robot")
        progress = Progress(recording.config["terms"], lambda line: tell("info", line))
        link = RobotLink(bus, options.run, options.wait, stop, tell, progress)
        bus.announce("robot", "main")
        began = time.monotonic()
        try:
            if config.clock == "lockstep":
                reason = run_lockstep(
                    plant,
                    controller,
                    task.actions,
                    referee,
                    link.ask_state,
                    lambda request: link.ask_plan(plant.read(), request),
                    recording,
                )
            else:
                # With a given speed too: it waits until everybody is there.
                fitting = calibrate(plant, controller.initial_memory(), link)
                speed = options.speed or fitting
                tell("info", f"realtime at {speed:.3f} of the wall clock")
                began = time.monotonic()
                reason = RealtimeLoop(
                    plant, controller, task, referee, link, recording, speed, stop, tell
                ).run()
        except Interrupted:
            reason = "interrupted"
        except SumoError as error:
            reason = f"fault: {error}"
        wall = time.monotonic() - began
        for _ in range(3):  # messages may be dropped, and nobody answers this one
            bus.publish(RunEnd(options.run, plant.tick, reason, success=reason == "success"))
            time.sleep(0.02)
    return _write(options.out, recording, Ending(reason, wall))


def _write(out: Path, recording: Recording, ending: Ending) -> int:
    out.mkdir(parents=True, exist_ok=True)
    recording.save(out / "run.npz")
    write_summary(summarise(recording, ending), out)
    return ending.exit_code
