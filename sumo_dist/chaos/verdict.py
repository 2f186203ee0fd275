"""What a run under faults must have been like."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sumo_dist.chaos.census import Growth
from sumo_dist.chaos.script import Script
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import read_summary
from sumo_dist.errors import SumoError
from sumo_dist.record.recording import Recording
from sumo_dist.robots.robot import Robot
from sumo_dist.rollout.interface import TICK
from sumo_dist.tasks import load_task

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sumo_dist.chaos.stage import Blow

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
        slowest_s: longest wall time from a fault's end to the next good plan; None without any.
        rate_hz: plans per second of wall time, while the robot's clock ran.
        rollouts: median per plan.
        growths: of the services that lived long enough.
        mangled: messages by what was done to them.
        failures: what was not as it must be; empty if all was.
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


def judge(
    script: Script,
    blows: "Sequence[Blow]",
    code: int | None,
    out: Path,
    growths: tuple[Growth, ...],
    mangled: dict[str, int],
) -> Outcome:
    """Compare a run with what it must be like."""
    failures = []
    if code is None:
        return Outcome(
            *(
                script.name,
                script.seed,
                len(blows),
                "it hangs",
                0,
                0,
                None,
                0.0,
                0.0,
                growths,
                mangled,
            ),
            ("it hangs",),
        )
    if crash := crashed((out / "messages.txt").read_text(errors="replace")):
        failures.append(f"a service crashed: {crash}")
    try:
        summary, recording = read_summary(out), Recording.load(out / "run.npz")
    except SumoError as error:
        return Outcome(
            *(
                script.name,
                script.seed,
                len(blows),
                f"exit code {code}",
                0,
                0,
                None,
                0.0,
                0.0,
                growths,
                mangled,
            ),
            (*failures, str(error)),
        )
    if not summary["end_reason"].startswith(script.ends):
        failures.append(f"it ended: {summary['end_reason']}")
    if len(blows) < script.count:
        failures.append(f"{len(blows)} of {script.count} faults happened before it ended")
    failures += unsafe(recording.targets, load_task(script.task).scene.robot)
    waits = [blow.resumed - blow.ended for blow in blows if blow.ended and blow.resumed]
    failures += _late(script, blows)
    failures += _grown(growths)
    if script.clock == "lockstep":
        failures += _other_bits(script, summary)
    return Outcome(
        *(script.name, script.seed, len(blows), summary["end_reason"], summary["plans"]),
        *(len(recording.targets), max(waits, default=None)),
        *(_rate(summary), summary["rollouts_per_plan_p50"] or 0.0, growths, mangled),
        tuple(failures),
    )


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


def _rate(summary: dict[str, Any]) -> float:
    """Plans per second of wall time."""
    seconds = summary["robot_time_s"] / (summary["real_time_factor"] or np.inf)
    return round(summary["plans"] / seconds, 2) if seconds else 0.0


def _grown(growths: "Sequence[Growth]") -> list[str]:
    """Services that keep on growing."""
    grown = []
    for growth in growths:
        mb, files = growth.mb[1] - growth.mb[0], growth.files[1] - growth.files[0]
        if mb > GROWTH_MB:
            grown.append(f"{growth.service} grew by {mb:.0f} MB")
        if files > GROWTH_FILES:
            grown.append(f"{growth.service} opened {files:.0f} files more")
    return grown


def _late(script: Script, blows: "Sequence[Blow]") -> list[str]:
    """Faults after whose end planning did not resume in time, unless the run ended before."""
    late = []
    for blow in blows:
        if blow.ended is None or blow.resumed is None:
            continue  # the run ended first: how it ended is judged
        if (took := blow.resumed - blow.ended) > script.resumes:
            late.append(
                f"planning resumed {took:.2f} s after {blow.fault.kind} {blow.fault.target}"
            )
    return late


def _other_bits(script: Script, summary: dict[str, Any]) -> list[str]:
    """A lockstep run must have the bits that one process makes of it undisturbed."""
    from sumo_dist.chaos.stage import episode_of

    recording, ending = run_single(episode_of(script), threads=1)
    if ending.reason == "interrupted":  # half a run has other digests, and says nothing
        raise KeyboardInterrupt
    expected = recording.plan_digest, recording.state_digest
    if (summary["plan_digest"], summary["state_digest"]) != expected:
        return ["its digests differ from those of the undisturbed run"]
    return []
