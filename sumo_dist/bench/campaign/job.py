"""One trial of a campaign: an episode, and the row that the journal gets of it."""

import hashlib
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sumo_dist.bench.layout import checked_engine
from sumo_dist.bench.results.journal import STANDING, Trial
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Nobody
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import Ending, fault
from sumo_dist.episode.referee import Referee
from sumo_dist.episode.single import run_planned, run_single
from sumo_dist.episode.summary import summarise, write_summary
from sumo_dist.errors import SumoError, TaskError
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.guidance import make_guide
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.planner.report import PlanReport
from sumo_dist.provenance import provenance
from sumo_dist.record.recording import Recording
from sumo_dist.rollout import engine_identity
from sumo_dist.tasks import load_task

Row = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """A trial as it is sent to its process.

    Attributes:
        trial: which one.
        episode: what to run.
        settings: what its row carries to be told from trials of other settings.
        folder: for its recording, if wanted.
        digest: of the states of the same trial before, which must come out again.
        cell: name of the campaign that it is of, where several are run side by side.
    """

    trial: Trial
    episode: EpisodeConfig
    settings: Mapping[str, Any]
    folder: Path | None = None
    digest: str | None = None
    cell: str = ""


def run_alone(question: tuple[str, str]) -> Row:
    """Run a trial without a campaign around it: its variant, and its episode as JSON."""
    variant, config = question
    episode = EpisodeConfig.from_json(config)
    trial = Trial(episode.task, episode.seed, variant)
    settings = {**common_settings(episode), **task_settings(episode)}
    about = {**trial._asdict(), **settings, "provenance": provenance()}
    return run_trial(Job(trial, episode, about))


def run_trial(job: Job) -> Row:
    """Run one episode in this process and return its row, with its CPU time.

    Raises:
        TaskError: the task does not load; whatever else of it raises is how the trial ended.
    """
    standing, began = job.trial.variant == STANDING, time.process_time()
    try:
        run = run_standing(job.episode) if standing else run_single(job.episode, threads=1)
    except TaskError as error:
        run = _not_begun(job.episode, error)
    recording, ending = run
    row = {**summarise(recording, ending), **job.settings, **outcome(job.episode, recording)}
    row["cpu_s"] = round(time.process_time() - began, 3)
    if standing:
        row["optimizer"] = "stand"
    if job.digest not in (None, row["state_digest"]):
        raise SumoError(
            f"{place(job)} did not repeat: its states have the digest "
            f"{row['state_digest'][:12]}, in the journal it is {job.digest[:12]}; "
            "equal bits need the same build and the same kind of processor"
        )
    if job.folder is not None:
        job.folder.mkdir(parents=True, exist_ok=True)
        write_summary(row, job.folder)
        recording.save(job.folder / "run.npz")
    return row


def run_standing(config: EpisodeConfig) -> tuple[Recording, Ending]:
    """Run the control: nobody plans and the robot stands, so what succeeds does so by itself."""
    episode = Episode.assemble(config)
    actions, nothing = episode.task.actions, np.zeros(0)
    knots = actions.unit(actions.default)[None].astype(np.float32)  # (1, n)

    def stand(request: PlanRequest, planner: PlannerConfig) -> PlanReport:
        plan = Plan(request.number, request.tick, knots, planner.horizon, "zero")
        cost = request.cost.weights, request.cost.parameters
        return PlanReport(plan, nothing, nothing.astype(bool), nothing, *cost, 0.0, 0.0)

    return episode.recording, run_planned(episode, stand, Nobody())


def _not_begun(config: EpisodeConfig, error: TaskError) -> tuple[Recording, Ending]:
    """Return what there is of an episode whose start the task cannot draw."""
    problem = Problem.build(load_task(config.task), planning_options(config.planner))
    return Recording(config.describe(problem, engine_identity(config.engine))), fault(error)


def outcome(episode: EpisodeConfig, recording: Recording) -> Row:
    """Return where an episode left off.

    Costs are those of the unperturbed candidate, term by term: the last plan's and the mean over
    all plans; the distance is that of what has a goal from it [m].
    """
    task = load_task(episode.task)
    terms = np.array(recording.terms)  # (plans, n_terms)
    names = recording.config["terms"] if terms.size else ()
    goal, distance = task.goal_position(task.table.named(episode.cost(task).parameters)), None
    if goal is not None and recording.states:
        view = Referee(task, compile_model(task.scene, PLANT)).view(recording.states[-1])
        distance = round(float(np.linalg.norm(view[task.goal_frame].pos[0, 0] - goal)), 4)
    return {
        "final_costs": dict(zip(names, terms[-1].tolist() if names else (), strict=True)),
        "mean_costs": dict(zip(names, terms.mean(axis=0).tolist() if names else (), strict=True)),
        "final_goal_distance_m": distance,
    }


def common_settings(episode: EpisodeConfig) -> Row:
    """Return what all rows of a campaign share."""
    _, build = checked_engine(episode.engine)
    names = ("plant", "estimator", "weight", "param")
    given = {name: asdict(episode)[name] for name in names}
    return {"engine_build": build, **_plain(given)}


def _plain(settings: Mapping[str, Any]) -> Row:
    """Return settings as JSON gives them back."""
    return {key: list(v) if isinstance(v, tuple) else v for key, v in settings.items()}


def task_settings(episode: EpisodeConfig) -> Row:
    """Return what all rows of a task share; compiles the task, so its errors come here.

    Raises:
        UsageError: there is no such task, or the episode's weights, parameters or settings are none
            that it can have.
    """
    task = load_task(episode.task)
    episode.cost(task)
    problem = Problem.build(task, planning_options(episode.planner))
    make_guide(problem, episode.planner)
    policy = {"policy_sha256": sha256(episode.planner.policy)} if episode.planner.policy else {}
    return {
        **policy,
        "time_limit_s": episode.time_limit or task.time_limit,
        "planner": asdict(episode.planner),
        "config_hash": episode.planner.hash(problem.hash),
    }


def sha256(path: str) -> str:
    """Hash a file: a policy that was trained on is another one under the same name."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def place(job: Job) -> str:
    """Name a trial in what is said of it."""
    standing = ", standing" if job.trial.variant == STANDING else ""
    cell = f", {job.cell}" if job.cell else ""
    return f"{job.trial.task} seed {job.trial.seed}{standing}{cell}"
