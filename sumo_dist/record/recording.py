"""A run on disk: one .npz that replays, audits and plots without the services."""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.planner.report import PlanReport

FORMAT = 1


@dataclass
class Recording:
    """What happened, tick by tick and plan by plan; grows during a run.

    Attributes:
        config: task, robot, seed, planner settings, hashes, versions, cost term names.
        states: per tick, (nq + nv,) the plant's state.
        estimates: per tick, (nq + nv,) the state that the policy and the planner saw.
        memories: per tick, (nm,) policy memory before that tick's evaluation.
        plan_numbers, plan_ticks, plan_ms: per plan; the tick it is anchored on; wall time [ms].
        age_ticks, lost, reissued: per plan, as in PlanReport.
        knots: per plan, (K, n) normalised actions.
        rollouts: per plan, candidates B it was made of; in realtime as many as the workers manage.
        costs: per plan, (B,) candidates' costs, +inf where lost or invalid; on disk all plans have
            as many as the largest, the rest +inf.
        terms: per plan, (n_terms,) weighted costs of the unperturbed candidate.
        traces: per plan, (B, F, P, 3) candidate paths; empty in a distributed run, whose tracer
            writes them to the .rrd.
        targets: (nu,) joint targets in the order they were sent, what the servos were told [rad].
        commands: joint targets sent, and how many the guard had to change, by reason.
    """

    config: dict[str, Any]
    states: list[np.ndarray] = field(default_factory=list)
    estimates: list[np.ndarray] = field(default_factory=list)
    memories: list[np.ndarray] = field(default_factory=list)
    plan_numbers: list[int] = field(default_factory=list)
    plan_ticks: list[int] = field(default_factory=list)
    plan_ms: list[float] = field(default_factory=list)
    age_ticks: list[int] = field(default_factory=list)
    lost: list[int] = field(default_factory=list)
    reissued: list[int] = field(default_factory=list)
    rollouts: list[int] = field(default_factory=list)
    knots: list[np.ndarray] = field(default_factory=list)
    costs: list[np.ndarray] = field(default_factory=list)
    terms: list[np.ndarray] = field(default_factory=list)
    traces: list[np.ndarray] = field(default_factory=list)
    targets: list[np.ndarray] = field(default_factory=list)
    commands: dict[str, int] = field(default_factory=dict)

    def add_tick(self, state: np.ndarray, estimate: np.ndarray, memory: np.ndarray) -> None:
        """Append what one tick began with."""
        self.states.append(state)
        self.estimates.append(estimate)
        self.memories.append(memory)

    def add_plan(self, report: PlanReport) -> None:
        """Append one plan and its account."""
        self.plan_numbers.append(report.plan.number)
        self.plan_ticks.append(report.plan.tick)
        self.plan_ms.append(report.plan_ms)
        self.age_ticks.append(report.age_ticks)
        self.lost.append(report.lost)
        self.reissued.append(report.reissued)
        self.rollouts.append(len(report.costs))
        self.knots.append(report.plan.knots)
        self.costs.append(np.where(report.finite, report.costs, np.inf))
        self.terms.append(report.terms)

    @property
    def plan_digest(self) -> str:
        """SHA-256 over all plans: number, tick and knots."""
        digest = hashlib.sha256()
        for number, tick, knots in zip(self.plan_numbers, self.plan_ticks, self.knots, strict=True):
            digest.update(np.array([number, tick], "<i8").tobytes())
            digest.update(np.asarray(knots, "<f4").tobytes())
        return digest.hexdigest()

    @property
    def state_digest(self) -> str:
        """SHA-256 over the plant's states at all ticks."""
        digest = hashlib.sha256()
        for state in self.states:
            digest.update(np.asarray(state, "<f8").tobytes())
        return digest.hexdigest()

    def save(self, path: Path) -> None:
        """Write atomically: a reader sees the whole file or none."""
        arrays: dict[str, Any] = {
            name: np.array(rows)
            for name, rows in vars(self).items()
            if name not in ("config", "commands", "costs")
        }
        most = max(map(len, self.costs), default=0)
        padded = [np.pad(c, (0, most - len(c)), constant_values=np.inf) for c in self.costs]
        arrays["costs"] = np.array(padded)
        partial = path.with_suffix(".part.npz")
        config, commands = json.dumps(self.config), json.dumps(self.commands)
        np.savez_compressed(partial, format=FORMAT, config=config, commands=commands, **arrays)
        partial.replace(path)

    @classmethod
    def load(cls, path: Path) -> "Recording":
        """Read a recording; a file that is none is one clear error."""
        try:
            with np.load(path, allow_pickle=False) as file:
                if int(file["format"]) != FORMAT:
                    raise UsageError(f"{path}: recording format {file['format']}, this is {FORMAT}")
                config = json.loads(str(file["config"]))
                commands = json.loads(str(file["commands"])) if "commands" in file else {}
                lists = {
                    name: list(file[name])
                    for name in file.files
                    if name not in ("format", "config", "commands")
                }
        except FileNotFoundError:
            raise UsageError(
                f"no recording at {path}; `sumo-dist run` writes one as DIR/run.npz"
            ) from None
        except (BadZipFile, EOFError, KeyError, ValueError, OSError) as error:
            raise UsageError(f"{path} is not a recording of sumo-dist: {error}") from None
        return cls(config, commands=commands, **lists)
