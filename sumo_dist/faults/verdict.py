"""What a run under faults must have been like."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import read_summary
from sumo_dist.errors import SumoError
from sumo_dist.faults.growth import Growth
from sumo_dist.faults.occurrence import FaultOccurrence, resume_delay
from sumo_dist.faults.script import Script
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.record.recording import Recording
from sumo_dist.robots.robot import Robot
from sumo_dist.tasks import load_task
from sumo_dist.timing import TICK

GROWTH_MB = 40.0  # in the second half of a life of seconds: a slow start ends there, no leak does
GROWTH_FILES = 20  # likewise: reconnecting opens some for a moment
_EXACT = 1e-9


@dataclass(frozen=True)
class RunRecord:
    """A run as it went."""

    script: Script
    folder: Path  # with the run's files and the services' messages
    exit_code: int | None  # the robot's, None if it hangs
    occurrences: Sequence[FaultOccurrence] = ()
    growths: Sequence[Growth] = ()  # of the services that lived long enough
    tampered: dict[str, int] = field(default_factory=dict)  # messages by what was done to them
    ended_at: float | None = None  # time.monotonic() of the robot's word that it is over [s]


@dataclass(frozen=True)
class Outcome:
    """A run as it is judged."""

    name: str  # of the script
    seed: int
    faults: int  # that happened
    end: str
    growths: tuple[Growth, ...]
    mangled: dict[str, int]  # messages by what was done to them
    failures: tuple[str, ...]  # what was not as it must be
    plans: int = 0
    commands: int = 0  # joint targets sent
    slowest_s: float | None = None  # longest of the faults' `resume_delay`
    rate_hz: float = 0.0  # plans per second of wall time, while the robot's clock ran
    rollouts: float = 0.0  # median per plan
    undisturbed: str = ""  # how the same run ended without faults, if this one fell


def judge(record: RunRecord, undisturbed: Callable[[], str]) -> Outcome:
    """Compare a run with what it must be like.

    Args:
        record: the run.
        undisturbed: plays the same run without faults and returns how it ended.
    """
    if record.exit_code is None:
        return _outcome(record, "it hangs", ["it hangs"])
    failures, script = [], record.script
    if crash := crashed((record.folder / "messages.txt").read_text(errors="replace")):
        failures.append(f"a service crashed: {crash}")
    try:
        summary = read_summary(record.folder)
        recording = Recording.load(record.folder / "run.npz")
    except SumoError as error:
        return _outcome(record, f"exit code {record.exit_code}", [*failures, str(error)])
    end = summary["end_reason"]
    fell = summary["end"] == End.FELL and script.clock == "realtime"
    without_faults = undisturbed() if fell and script.faults else ""
    failures += _wrong_end(record, end, without_faults)
    failures += unsafe(recording.targets, load_task(script.task).scene.robot)
    # it sat down, and asked for no plans from then on
    sat_down = summary["end"] in (End.FAULT, End.STOPPED, End.INTERRUPTED, End.FELL)
    until = None if sat_down else record.ended_at
    delays = [(o, resume_delay(o, record.occurrences, until)) for o in record.occurrences]
    failures += _late(script, delays) + _grown(record.growths)
    if script.clock == "lockstep":
        failures += _other_bits(script, summary)
    resumed = (delay for o, delay in delays if delay is not None and o.resumed is not None)
    return _outcome(
        record,
        end,
        failures,
        plans=summary["plans"],
        commands=len(recording.targets),
        slowest_s=max(resumed, default=None),
        rate_hz=_rate(summary),
        rollouts=summary["rollouts_per_plan_p50"] or 0.0,
        undisturbed=without_faults,
    )


def _outcome(record: RunRecord, end: str, failures: Sequence[str], **found: Any) -> Outcome:
    about = record.script.name, record.script.seed, len(record.occurrences)
    return Outcome(*about, end, tuple(record.growths), record.tampered, tuple(failures), **found)


def _wrong_end(record: RunRecord, end: str, without_faults: str) -> list[str]:
    """Say what is wrong with how a run ended."""
    if without_faults == end:
        return []
    wrong, happened, planned = [], len(record.occurrences), record.script.count
    if not end.startswith(record.script.ends):
        compared = f"; without faults: {without_faults}" if without_faults else ""
        wrong.append(f"it ended: {end}{compared}")
    if happened < planned:
        wrong.append(f"{happened} of {planned} faults happened before it ended")
    return wrong


def crashed(messages: str) -> str:
    """Return the first traceback through this package that services left, "" if none did."""
    for part in messages.split("Traceback (most recent call last):")[1:]:
        lines = part.lstrip("\n").splitlines()
        frames = [line for line in lines if line.startswith("  ")]
        if any("sumo_dist" in line or "services" in line for line in frames):
            return next((line for line in lines if not line.startswith(" ")), "").strip()
    return ""


def unsafe(targets: "Sequence[np.ndarray]", robot: Robot) -> list[str]:
    """Say which of the commands that were sent broke a limit of the robot, however they came."""
    sent, safety = np.array([robot.stand, *map(np.asarray, targets)]), robot.safety
    wrong = []
    if not np.isfinite(sent).all():
        wrong.append("a command that is not finite was sent")
    if safety.target_upper and (sent > np.array(safety.target_upper) + _EXACT).any():
        wrong.append("a command above its limit was sent")
    if safety.target_lower and (sent < np.array(safety.target_lower) - _EXACT).any():
        wrong.append("a command below its limit was sent")
    if safety.target_rate:
        steps = np.abs(np.diff(sent, axis=0))
        if (steps > np.array(safety.target_rate) * TICK + _EXACT).any():
            wrong.append("a command beyond its rate was sent")
    return wrong


def counted(growths: Sequence[Growth]) -> list[Growth]:
    """Leave out the tracer, which loads Rerun late and keeps what it shows."""
    return [growth for growth in growths if growth.service != "tracer"]


def _grown(growths: Sequence[Growth]) -> list[str]:
    """Say which services keep on growing."""
    grown = []
    for growth in counted(growths):
        mb, files = growth.mb[1] - growth.mb[0], growth.files[1] - growth.files[0]
        if mb > GROWTH_MB:
            grown.append(f"{growth.service} grew by {mb:.0f} MB")
        if files > GROWTH_FILES:
            grown.append(f"{growth.service} opened {files:.0f} files more")
    return grown


def _late(script: Script, delays: Sequence[tuple[FaultOccurrence, float | None]]) -> list[str]:
    """Say after which faults planning did not resume in time, unless the run ended before."""
    late = []
    for occurrence, delay in delays:
        if delay is not None and delay > script.resumes:
            resumed = occurrence.resumed is not None
            how = f"planning resumed {delay:.2f} s" if resumed else f"no plan for {delay:.2f} s"
            late.append(f"{how} after {occurrence.fault.kind} {occurrence.fault.target}".rstrip())
    return late


def _rate(summary: dict[str, Any]) -> float:
    """Plans per second of wall time."""
    seconds = summary["robot_time_s"] / (summary["real_time_factor"] or np.inf)
    return round(summary["plans"] / seconds, 2) if seconds else 0.0


def _other_bits(script: Script, summary: dict[str, Any]) -> list[str]:
    """A lockstep run must have the bits of the undisturbed run in one process."""
    recording, ending = run_single(episode_of(script), threads=1)
    if ending.kind is End.INTERRUPTED:  # half a run has other digests, which prove nothing
        raise KeyboardInterrupt
    expected = recording.plan_digest, recording.state_digest
    if (summary["plan_digest"], summary["state_digest"]) != expected:
        return ["its digests differ from those of the undisturbed run"]
    return []


def episode_of(script: Script) -> EpisodeConfig:
    """Return the run of a script."""
    of_task = load_task(script.task).planner
    planner = PlannerConfig.resolve(of_task, settings=script.settings)
    return EpisodeConfig(
        *(script.task, script.seed, planner, script.clock, script.estimator, script.time_limit)
    )
