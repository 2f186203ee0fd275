"""What a run under faults must have been like."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import FAULTS
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import read_summary
from sumo_dist.errors import SumoError
from sumo_dist.faults.growth import Growth
from sumo_dist.faults.occurrence import Blow, waited
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
class Outcome:
    """One script as it went.

    Attributes:
        name: of the script.
        seed: of the run.
        faults: that happened.
        end: how the run ended.
        plans: made.
        commands: joint targets sent.
        slowest_s: longest wall time from a fault's end, and that of all that overlap it, to the
            next good plan; None without any.
        rate_hz: plans per second of wall time, while the robot's clock ran.
        rollouts: median per plan.
        growths: of the services that lived long enough.
        mangled: messages by what was done to them.
        failures: what was not as it must be; empty if all was.
        undisturbed: how the same run ended without faults, if this one fell; else "".
    """

    name: str
    seed: int
    faults: int
    end: str
    plans: int
    commands: int
    slowest_s: float | None
    rate_hz: float
    rollouts: float
    growths: tuple[Growth, ...]
    mangled: dict[str, int]
    failures: tuple[str, ...]
    undisturbed: str = ""


def judge(
    script: Script,
    blows: "Sequence[Blow]",
    code: int | None,
    out: Path,
    growths: tuple[Growth, ...],
    mangled: dict[str, int],
    until: float | None,
    undisturbed: Callable[[], str],
) -> Outcome:
    """Compare a run with what it must be like.

    Args:
        script: that was played.
        blows: its faults as they happened.
        code: the robot's exit code, None if it hangs.
        out: the run's folder.
        growths, mangled: see Outcome.
        until: time.monotonic() at which the run ended, None if nobody heard of it.
        undisturbed: plays the same run without faults and returns how it ended.
    """
    nothing = (0, 0, None, 0.0, 0.0, growths, mangled)
    if code is None:
        return Outcome(script.name, script.seed, len(blows), "it hangs", *nothing, ("it hangs",))
    failures = []
    if crash := crashed((out / "messages.txt").read_text(errors="replace")):
        failures.append(f"a service crashed: {crash}")
    try:
        summary, recording = read_summary(out), Recording.load(out / "run.npz")
    except SumoError as error:
        failures.append(str(error))
        return Outcome(
            *(script.name, script.seed, len(blows), f"exit code {code}", *nothing), tuple(failures)
        )
    end = summary["end_reason"]
    fell = end == "fell" and script.clock == "realtime"
    alone = undisturbed() if fell and script.faults else ""
    failures += _other_end(script, end, alone, len(blows))
    failures += unsafe(recording.targets, load_task(script.task).scene.robot)
    sat = end.startswith((*FAULTS, "fell"))  # and asked for no plans from then on
    waits = [(blow, waited(blow, blows, None if sat else until)) for blow in blows]
    failures += _late(script, waits) + _grown(growths)
    if script.clock == "lockstep":
        failures += _other_bits(script, summary)
    return Outcome(
        *(script.name, script.seed, len(blows), end, summary["plans"], len(recording.targets)),
        *(_longest(waits), _rate(summary), summary["rollouts_per_plan_p50"] or 0.0),
        *(growths, mangled, tuple(failures), alone),
    )


def _other_end(script: Script, end: str, alone: str, happened: int) -> list[str]:
    """Say what is wrong with how a run ended; `alone` is how it ended without faults, if known."""
    if alone == end:
        return []
    wrong = []
    if not end.startswith(script.ends):
        wrong.append(f"it ended: {end}" + (f"; without faults: {alone}" if alone else ""))
    if happened < script.count:
        wrong.append(f"{happened} of {script.count} faults happened before it ended")
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
    for name, limits, sign in (
        ("above", safety.target_upper, 1.0),
        ("below", safety.target_lower, -1.0),
    ):
        if limits and (sign * (sent - np.array(limits)) > _EXACT).any():
            wrong.append(f"a command {name} its limit was sent")
    if safety.target_rate:
        step = np.abs(np.diff(sent, axis=0))
        if (step > np.array(safety.target_rate) * TICK + _EXACT).any():
            wrong.append("a command beyond its rate was sent")
    return wrong


def _longest(waits: Sequence[tuple[Blow, float | None]]) -> float | None:
    """Return the longest wait of a fault after which planning resumed [s]; None without any."""
    seen = (wait for blow, wait in waits if wait is not None and blow.resumed is not None)
    return max(seen, default=None)


def _rate(summary: dict[str, Any]) -> float:
    """Plans per second of wall time."""
    seconds = summary["robot_time_s"] / (summary["real_time_factor"] or np.inf)
    return round(summary["plans"] / seconds, 2) if seconds else 0.0


def counted(growths: "Sequence[Growth]") -> "list[Growth]":
    """Leave out the tracer, which loads Rerun late and keeps what it shows."""
    return [growth for growth in growths if growth.service != "tracer"]


def _grown(growths: "Sequence[Growth]") -> list[str]:
    """Services that keep on growing."""
    grown = []
    for growth in counted(growths):
        mb, files = growth.mb[1] - growth.mb[0], growth.files[1] - growth.files[0]
        if mb > GROWTH_MB:
            grown.append(f"{growth.service} grew by {mb:.0f} MB")
        if files > GROWTH_FILES:
            grown.append(f"{growth.service} opened {files:.0f} files more")
    return grown


def _late(script: Script, waits: Sequence[tuple[Blow, float | None]]) -> list[str]:
    """Faults after whose end planning did not resume in time, unless the run ended before."""
    late = []
    for blow, wait in waits:
        if wait is None or wait <= script.resumes:
            continue  # in time, or the run ended first: how it ended is judged
        how = f"planning resumed {wait:.2f} s" if blow.resumed else f"no plan for {wait:.2f} s"
        late.append(f"{how} after {blow.fault.kind} {blow.fault.target}".rstrip())
    return late


def episode_of(script: Script) -> EpisodeConfig:
    """Return the run of a script."""
    return EpisodeConfig(
        script.task,
        script.seed,
        PlannerConfig().with_settings(script.settings),
        script.clock,
        script.estimator,
        script.time_limit,
    )


def _other_bits(script: Script, summary: dict[str, Any]) -> list[str]:
    """A lockstep run must have the bits that one process makes of it undisturbed."""
    recording, ending = run_single(episode_of(script), threads=1)
    if ending.reason == "interrupted":  # half a run has other digests, and says nothing
        raise KeyboardInterrupt
    expected = recording.plan_digest, recording.state_digest
    if (summary["plan_digest"], summary["state_digest"]) != expected:
        return ["its digests differ from those of the undisturbed run"]
    return []
