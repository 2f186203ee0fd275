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

FORMAT = 3
_READABLE = (2, FORMAT)
_ABOUT = ("config", "commands", "operator", "motion", "ending")
_MODEL = "model"  # all other fields are arrays
_SINCE_THEN = ("motion",)  # that recordings of format 2 may not have; they have no model either
_TICKS = ("states", "estimates", "memories")
_PLANS = (
    *("plan_numbers", "plan_ticks", "plan_ms", "age_ticks", "lost", "reissued", "rollouts"),
    *("knots", "costs", "terms", "weights", "parameters"),
)
_PLANS_OF_ONE_PROCESS = ("traces", "plan_cpu_ms")  # that a distributed run does not have


@dataclass
class Recording:
    """What happened, tick by tick and plan by plan; grows, on disk, during a run.

    Attributes:
        config: the episode's configuration, hashes, versions, names of cost terms and parameters,
            the task as far as it is data; see `EpisodeConfig.describe`.
        states: per tick, (nq + nv,) the true state, or the estimate where nobody knows it.
        estimates: per tick, (nq + nv,) the state that the policy and the planner saw.
        memories: per tick, (nm,) policy memory before that tick's evaluation.
        plan_numbers, plan_ticks, plan_ms: per plan; the tick it is anchored on; wall time [ms].
        age_ticks, lost, reissued: per plan, as in PlanReport.
        knots: per plan, (K, n) normalised actions.
        rollouts: per plan, candidates B it was made of; in realtime as many as the workers manage.
        costs: per plan, (B,) candidates' costs, +inf where lost or invalid; where a plan had fewer
            candidates than were configured at the start the rest is +inf as well, and of more only
            the first are here.
        terms: per plan, (n_terms,) weighted costs of the unperturbed candidate.
        weights, parameters: per plan, (n_terms,) and (n,), that it was made with.
        traces: per plan, (B, F, P, 3) candidate paths, as many as costs; empty in a distributed
            run, whose tracer writes them to the .rrd, and nan for plans that were taken from one.
        plan_cpu_ms: per plan, CPU time of all threads of the process [ms]; empty in a distributed
            run, and in recordings of older versions.
        late_ms: per command of the policy in realtime, wall time from its tick to the command [ms].
        actions: per tick in which a plan was followed, (nu,) the action, in its own units.
        targets: (nu,) joint targets in the order they were sent, what the servos were told [rad].
        commands: joint targets sent, and how many the guard had to change, by reason.
        operator: what an operator commanded, each with its tick, in the order it was carried out.
        motion: what the robot's motion asks of hardware, see episode.motion.
        ending: how the episode ended, in words; "" while it runs.
        model: of the world, see `record.world`; empty in recordings of older versions.
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
    weights: Rows = field(default_factory=Rows)
    parameters: Rows = field(default_factory=Rows)
    traces: Rows = field(default_factory=Rows)
    plan_cpu_ms: Rows = field(default_factory=Rows)
    late_ms: Rows = field(default_factory=Rows)
    actions: Rows = field(default_factory=Rows)
    targets: Rows = field(default_factory=Rows)
    commands: dict[str, int] = field(default_factory=dict)
    operator: list[dict[str, Any]] = field(default_factory=list)
    motion: dict[str, float] = field(default_factory=dict)
    ending: str = ""
    model: bytes = b""

    def add_tick(self, state: np.ndarray, estimate: np.ndarray, memory: np.ndarray) -> None:
        """Append what one tick began with."""
        self.states.append(state)
        self.estimates.append(estimate)
        self.memories.append(memory)

    def add_plan(self, report: PlanReport) -> None:
        """Append one plan, its account, and what it was made with."""
        self.plan_numbers.append(report.plan.number)
        self.plan_ticks.append(report.plan.tick)
        self.plan_ms.append(report.plan_ms)
        self.age_ticks.append(report.age_ticks)
        self.lost.append(report.lost)
        self.reissued.append(report.reissued)
        self.rollouts.append(len(report.costs))
        self.knots.append(report.plan.knots)
        costs = np.where(report.finite, report.costs, np.inf)
        self.costs.append(self._fitted(costs, np.inf))
        self.terms.append(report.terms)
        self.weights.append(report.weights)
        self.parameters.append(report.parameters)

    def add_traces(self, traces: np.ndarray) -> None:
        """Append the candidates' paths of one plan."""
        self.traces.append(self._fitted(traces, 0.0))

    def seen(self, plan: int) -> bool:
        """Whether the candidates' paths of a plan, by its row, are here."""
        return plan < len(self.traces) and not bool(np.isnan(self.traces[plan]).all())

    def drop_unfinished(self) -> None:
        """Drop a tick or a plan of which an interrupt let only a part be appended."""
        self.cut(*(min(len(getattr(self, name)) for name in names) for names in (_TICKS, _PLANS)))

    def cut(self, ticks: int, plans: int) -> None:
        """Drop what comes after so many ticks and plans."""
        for names, length in ((_TICKS, ticks), ((*_PLANS, *_PLANS_OF_ONE_PROCESS), plans)):
            for name in names:
                getattr(self, name).cut(length)

    def _fitted(self, rows: np.ndarray, missing: float) -> np.ndarray:
        """Rows of a plan's candidates, as many as a plan has that has all of them."""
        rows = rows[: self._candidates]
        lacking = [(0, self._candidates - len(rows))] + [(0, 0)] * (rows.ndim - 1)
        return np.pad(rows, lacking, constant_values=missing)

    @cached_property
    def _candidates(self) -> int:
        """Candidates of a plan that has all of them."""
        return PlannerConfig.from_settings(self.config["episode"]["planner"]).populations[-1]

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

    def save(self, path: Path | str) -> None:
        """Write atomically: a reader sees the whole file or none."""
        path = Path(path)
        partial = path.with_suffix(".part.npz")
        about = {"format": FORMAT, "config": json.dumps(self.config)}
        about |= {name: json.dumps(getattr(self, name)) for name in _ABOUT[1:]}
        about |= {_MODEL: np.frombuffer(self.model, np.uint8)}
        with ZipFile(partial, "w", ZIP_DEFLATED) as archive:
            for name, value in about.items():
                with archive.open(f"{name}.npy", "w") as file:
                    np.lib.format.write_array(file, np.asanyarray(value))
            for name in (each.name for each in fields(self) if each.name not in about):
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    getattr(self, name).write(file)
        partial.replace(path)

    @classmethod
    def load(cls, path: Path | str) -> "Recording":
        """Read a recording, or the one of a run's folder; what is none is one clear error."""
        path = Path(path)
        path = path / "run.npz" if path.is_dir() else path
        try:
            with np.load(path, allow_pickle=False) as file:
                if int(file["format"]) not in _READABLE:
                    raise UsageError(f"{path}: recording format {file['format']}, this is {FORMAT}")
                there = [name for name in _ABOUT if name in file or name not in _SINCE_THEN]
                about = {name: json.loads(str(file[name])) for name in there}
                arrays: dict[str, Any] = {
                    name: Rows(file[name])
                    for name in file.files
                    if name not in ("format", _MODEL, *_ABOUT)
                }
                if _MODEL in file.files:
                    arrays[_MODEL] = np.asarray(file[_MODEL], np.uint8).tobytes()
        except FileNotFoundError:
            raise UsageError(
                f"no recording at {path}; `sumo-dist run` writes one as DIR/run.npz"
            ) from None
        except (BadZipFile, EOFError, KeyError, ValueError, OSError) as error:
            raise UsageError(f"{path} is not a recording of sumo-dist: {error}") from None
        return cls(**about, **arrays)
