"""A run on disk: one .npz that replays, audits and plots without the services."""

import hashlib
import json
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, BadZipFile, ZipFile

import numpy as np

from sumo_dist.errors import UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.rows import Rows

FORMAT = 1
_ABOUT = ("config", "commands")  # all other fields are arrays
_TICKS = ("states", "estimates", "memories")
_PLANS = (
    *("plan_numbers", "plan_ticks", "plan_ms", "age_ticks", "lost", "reissued", "rollouts"),
    *("knots", "costs", "terms"),
)


@dataclass
class Recording:
    """What happened, tick by tick and plan by plan; grows, on disk, during a run.

    Attributes:
        config: task, robot, seed, planner settings, hashes, versions, cost term names.
        states: per tick, (nq + nv,) the plant's state.
        estimates: per tick, (nq + nv,) the state that the policy and the planner saw.
        memories: per tick, (nm,) policy memory before that tick's evaluation.
        plan_numbers, plan_ticks, plan_ms: per plan; the tick it is anchored on; wall time [ms].
        age_ticks, lost, reissued: per plan, as in PlanReport.
        knots: per plan, (K, n) normalised actions.
        rollouts: per plan, candidates B it was made of; in realtime as many as the workers manage.
        costs: per plan, (B,) candidates' costs, +inf where lost or invalid; where a plan had fewer
            candidates than configured the rest is +inf as well.
        terms: per plan, (n_terms,) weighted costs of the unperturbed candidate.
        traces: per plan, (B, F, P, 3) candidate paths; empty in a distributed run, whose tracer
            writes them to the .rrd.
        late_ms: per command of the policy in realtime, wall time from its tick to the command [ms].
        targets: (nu,) joint targets in the order they were sent, what the servos were told [rad].
        commands: joint targets sent, and how many the guard had to change, by reason.
    """

    config: dict[str, Any]
    states: Rows = field(default_factory=Rows)
    estimates: Rows = field(default_factory=Rows)
    memories: Rows = field(default_factory=Rows)
    plan_numbers: Rows = field(default_factory=Rows)
    plan_ticks: Rows = field(default_factory=Rows)
    plan_ms: Rows = field(default_factory=Rows)
    age_ticks: Rows = field(default_factory=Rows)
    lost: Rows = field(default_factory=Rows)
    reissued: Rows = field(default_factory=Rows)
    rollouts: Rows = field(default_factory=Rows)
    knots: Rows = field(default_factory=Rows)
    costs: Rows = field(default_factory=Rows)
    terms: Rows = field(default_factory=Rows)
    traces: Rows = field(default_factory=Rows)
    late_ms: Rows = field(default_factory=Rows)
    targets: Rows = field(default_factory=Rows)
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
        costs = np.where(report.finite, report.costs, np.inf)
        missing = max(0, self._candidates - len(costs))
        self.costs.append(np.pad(costs, (0, missing), constant_values=np.inf))
        self.terms.append(report.terms)

    def drop_unfinished(self) -> None:
        """Drop a tick or a plan of which an interrupt let only a part be appended."""
        for names in (_TICKS, _PLANS):
            columns = [getattr(self, name) for name in names]
            whole = min(map(len, columns))
            for column in columns:
                column.cut(whole)
        self.traces.cut(len(self.plan_numbers))

    @cached_property
    def _candidates(self) -> int:
        """Candidates of a plan that has all of them."""
        return PlannerConfig.from_settings(self.config["planner"]).populations[-1]

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
        partial = path.with_suffix(".part.npz")
        about = {"format": FORMAT, "config": json.dumps(self.config)}
        about["commands"] = json.dumps(self.commands)
        with ZipFile(partial, "w", ZIP_DEFLATED) as archive:
            for name, value in about.items():
                with archive.open(f"{name}.npy", "w") as file:
                    np.lib.format.write_array(file, np.asanyarray(value))
            for name in (each.name for each in fields(self) if each.name not in _ABOUT):
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    getattr(self, name).write(file)
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
                arrays = {n: Rows(file[n]) for n in file.files if n not in ("format", *_ABOUT)}
        except FileNotFoundError:
            raise UsageError(
                f"no recording at {path}; `sumo-dist run` writes one as DIR/run.npz"
            ) from None
        except (BadZipFile, EOFError, KeyError, ValueError, OSError) as error:
            raise UsageError(f"{path} is not a recording of sumo-dist: {error}") from None
        return cls(config, commands=commands, **arrays)
