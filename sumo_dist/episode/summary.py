"""The account of a finished run: summary.json and the one line a person reads."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.episode.ending import Ending
from sumo_dist.errors import SumoError
from sumo_dist.record.recording import Recording
from sumo_dist.timing import TICK

_SUMMARY = "summary.json"
_TROUBLES = ("missed_deadlines", "partial_plans", "rollouts_lost")


def summarise(recording: Recording, ending: Ending) -> dict[str, Any]:
    """Return the content of summary.json.

    Its counters: `missed_deadlines`, planning periods without a new plan; `partial_plans`, plans
    made without some of their candidates; `rollouts_lost`, candidates left out or asked for twice;
    `plan_cpu_ms` and `plan_cpu_s`, where one process does it all, CPU time of planning: the mean of
    a plan and that of all; `command_late_ms`, in realtime, wall time from a policy's tick to its
    command; `commands`, joint targets sent and how many of them the guard changed, by reason;
    `motion`, see episode.motion.
    """
    plan_ms = np.array(recording.plan_ms or [np.nan])
    cpu_ms = np.array(recording.plan_cpu_ms or [np.nan])
    seconds = max(len(recording.states) - 1, 0) * TICK
    config = recording.config["episode"]
    return {
        "task": recording.config["task_name"],
        **{key: recording.config[key] for key in ("robot", "engine", "config_hash")},
        "optimizer": config["planner"]["optimizer"],
        **{key: config[key] for key in ("clock", "seed", "plant", "estimator")},
        "success": ending.success,
        "completion_time_s": round(seconds, 2) if ending.success else None,
        "robot_time_s": round(seconds, 2),
        "end": ending.kind.value,
        "end_reason": ending.reason,
        "plans": len(recording.plan_ms),
        "plan_ms_p50": _finite(np.percentile(plan_ms, 50)),
        "plan_ms_p99": _finite(np.percentile(plan_ms, 99)),
        "plan_cpu_ms": _finite(cpu_ms.mean()),
        "plan_cpu_s": _finite(cpu_ms.sum() * 1e-3),
        "missed_deadlines": int(np.maximum(np.diff(recording.plan_numbers) - 1, 0).sum()),
        "partial_plans": int(np.count_nonzero(recording.lost)),
        "rollouts_lost": int(np.sum(recording.lost) + np.sum(recording.reissued)),
        "rollouts_per_plan_p50": _finite(np.percentile(recording.rollouts or [np.nan], 50)),
        "rollouts_per_plan_min": _finite(min(recording.rollouts, default=np.nan)),
        "plan_age_ms_p50": _age_ms(recording, 50),
        "plan_age_ms_p99": _age_ms(recording, 99),
        "command_late_ms_p50": _finite(np.percentile(recording.late_ms or [np.nan], 50)),
        "command_late_ms_p99": _finite(np.percentile(recording.late_ms or [np.nan], 99)),
        "commands": recording.commands,
        "motion": recording.motion,
        "real_time_factor": round(seconds / ending.wall_s, 4) if ending.wall_s > 0 else None,
        "plan_digest": recording.plan_digest,
        "state_digest": recording.state_digest,
        "versions": recording.config["versions"],
    }


def keep(recording: Recording, ending: Ending, folder: Path) -> None:
    """Write DIR/summary.json and DIR/run.npz.

    Raises:
        SumoError: the disk does not take them; what fits is there, the summary first.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_summary(summarise(recording, ending), folder)
        recording.save(folder / "run.npz")
    except OSError as error:
        raise SumoError(
            f"the run ended ({ending.reason}) and {folder} cannot take it: {error}"
        ) from None


def write_summary(summary: dict[str, Any], folder: Path) -> None:
    """Write DIR/summary.json."""
    (folder / _SUMMARY).write_text(json.dumps(summary, indent=2) + "\n")


def read_summary(folder: Path) -> dict[str, Any]:
    """Read DIR/summary.json."""
    try:
        return json.loads((folder / _SUMMARY).read_text())
    except (OSError, json.JSONDecodeError) as error:
        raise SumoError(f"the run left no readable {folder / _SUMMARY}: {error}") from None


def has_summary(folder: Path) -> bool:
    """Whether there is a DIR/summary.json: a run that ends before its episode begins has none."""
    return (folder / _SUMMARY).exists()


def one_line(summary: dict[str, Any]) -> str:
    """Return the line a run ends with."""
    seconds = summary["robot_time_s"]
    outcome = (
        f"solved in {seconds:.1f} s"
        if summary["success"]
        else f"not solved: {summary['end_reason']}"
    )
    p50, p99 = summary["plan_ms_p50"] or 0, summary["plan_ms_p99"] or 0
    parts = [
        f"{summary['task']} seed {summary['seed']}: {outcome}",
        f"{summary['plans']} plans of {p50:.0f} ms (p99 {p99:.0f})",
        f"{summary['real_time_factor'] or 0:.2f}x real time",
        f"{summary['optimizer']} on {summary['engine']}",
    ]
    lost = [f"{summary[key]} {key.replace('_', ' ')}" for key in _TROUBLES if summary[key]]
    return ", ".join(parts + lost)


def _age_ms(recording: Recording, percent: int) -> float | None:
    """Percentile of the robot time from a plan's state to the plan [ms]."""
    ages = np.array(recording.age_ticks or [np.nan]) * TICK * 1e3
    return _finite(np.percentile(ages, percent))


def _finite(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None
