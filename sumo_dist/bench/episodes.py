"""`sumo-dist bench episodes`: many seeds of some tasks, counted."""

import statistics
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from sumo_dist.bench.journal import Journal
from sumo_dist.bench.processes import run_each
from sumo_dist.bench.report import checked_engine, cores, markdown, wilson
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.referee import Referee
from sumo_dist.episode.single import run_single
from sumo_dist.episode.summary import summarise, write_summary
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task


@dataclass(frozen=True)
class Options:
    """Options of `bench episodes`.

    Attributes:
        tasks: names, separated by commas; `sumo-dist list` names all.
        out: file that gets one JSON object per trial; a campaign that was killed goes on from it.
        trials: seeds per task.
        seed0: the first seed.
        optimizer: cem, mppi or ps.
        set: planner settings as key=value; `sumo-dist list` names all.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
        time_limit: robot time per trial [s]; the tasks' own by default.
        jobs: trials at a time; by default one for each core.
        recordings: folder that gets each trial's recording, for `sumo-dist replay`.
    """

    tasks: str
    out: Path
    trials: int = 20
    seed0: int = 1
    optimizer: str = "cem"
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    engine: str = "auto"
    time_limit: float | None = None
    jobs: int | None = None
    recordings: Path | None = None

    def episodes(self) -> list[EpisodeConfig]:
        """Return the trials, checked."""
        if self.trials < 1:
            raise UsageError(f"trials must be at least 1, got {self.trials}")
        planner = replace(PlannerConfig().with_settings(self.set), optimizer=self.optimizer)
        return [
            EpisodeConfig(task, seed, planner, time_limit=self.time_limit, engine=self.engine)
            for task in dict.fromkeys(load_task(name).source for name in self.tasks.split(","))
            for seed in range(self.seed0, self.seed0 + self.trials)
        ]


@dataclass(frozen=True)
class Job:
    """A trial as it is sent to its process.

    Attributes:
        episode: what to run.
        settings: what its row carries to be told from trials of other settings.
        folder: for its recording, if wanted.
    """

    episode: EpisodeConfig
    settings: dict[str, Any]
    folder: Path | None


def main(options: Options) -> int:
    """Run what the file lacks, print the table; 3 if a trial's process died."""
    episodes = options.episodes()
    jobs = options.jobs if options.jobs is not None else cores()
    if jobs < 1:
        raise UsageError(f"jobs must be at least 1, got {jobs}")
    settings = common_settings(episodes[0])
    of_task = {e.task: task_settings(e) for e in episodes}
    journal = Journal(options.out, settings, of_task, _say)
    todo = [
        Job(e, {**settings, **of_task[e.task]}, _folder(options.recordings, e))
        for e in episodes
        if (e.task, e.seed) not in journal.rows
    ]
    if done := len(episodes) - len(todo):
        _say(f"{options.out} has {done} of {len(episodes)} trials, {len(todo)} to go")
    died = _campaign(todo, jobs, journal)
    rows = [journal.rows.get((e.task, e.seed)) for e in episodes]
    print(table([row for row in rows if row is not None]))
    if died:
        raise SumoError(
            f"the processes of {died} trials died (out of memory?); run again to repeat them"
        )
    return 0


def common_settings(episode: EpisodeConfig) -> dict[str, Any]:
    """Return what all rows of a campaign share."""
    _, build = checked_engine(episode.engine)
    return {"planner": asdict(episode.planner), "engine_build": build}


def task_settings(episode: EpisodeConfig) -> dict[str, Any]:
    """Return what all rows of a task share; compiles the task, so its errors come here."""
    task = load_task(episode.task)
    problem = Problem.build(task, planning_options(episode.planner))
    return {
        "time_limit_s": episode.time_limit or task.time_limit,
        "config_hash": episode.planner.hash(problem.hash),
    }


def run_trial(job: Job) -> dict[str, Any]:
    """Run one episode in this process and return its row."""
    recording, ending = run_single(job.episode, threads=1)
    row = {**summarise(recording, ending), **job.settings, **outcome(job.episode, recording)}
    if job.folder is not None:
        job.folder.mkdir(parents=True, exist_ok=True)
        recording.save(job.folder / "run.npz")
        write_summary(row, job.folder)
    return row


def outcome(episode: EpisodeConfig, recording: Recording) -> dict[str, Any]:
    """Return where an episode left off: costs of the last plan, and object to goal [m] if any."""
    task = load_task(episode.task)
    referee = Referee(task, compile_model(task.scene, PLANT))
    costs = recording.terms[-1].tolist() if recording.terms else []
    distance = None
    if task.goal is not None and "object" in task.frames:
        at = referee.view(recording.states[-1]).object.pos[0, 0]
        distance = round(float(np.linalg.norm(at - np.array(task.goal))), 4)
    return {
        "task": episode.task,
        "final_costs": dict(zip(recording.config["terms"], costs, strict=False)),
        "final_goal_distance_m": distance,
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Lay out the successes of each task."""
    tasks = dict.fromkeys(row["task"] for row in rows)
    head = ("task", "success", "rate", "Wilson 95 %", "median [s]", "mean [s]", "ended by")
    return markdown(head, [_count(t, [r for r in rows if r["task"] == t]) for t in tasks])


def _count(task: str, rows: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    times = [row["completion_time_s"] for row in rows if row["success"]]
    low, high = wilson(len(times), len(rows))
    return (
        task,
        f"{len(times)}/{len(rows)}",
        f"{len(times) / len(rows):.2f}",
        f"{low:.2f} to {high:.2f}",
        f"{statistics.median(times):.2f}" if times else "-",
        f"{statistics.mean(times):.2f}" if times else "-",
        ", ".join(f"{reason} {n}" for reason, n in Counter(r["end_reason"] for r in rows).items()),
    )


def _campaign(todo: Sequence[Job], jobs: int, journal: Journal) -> int:
    """Run trials, append each as it ends, and return how many ended without a result."""
    began, died = time.monotonic(), 0
    for number, (job, row) in enumerate(run_each(run_trial, todo, jobs), 1):
        left = (time.monotonic() - began) / number * (len(todo) - number)
        place = f"[{number}/{len(todo)}, {left / 60:.0f} min left]"
        name = f"{job.episode.task} seed {job.episode.seed}"
        if row is None:
            died += 1
            _say(f"{place} {name}: its process died")
            continue
        journal.append(row)
        distance = row["final_goal_distance_m"]
        left_off = f", object {distance:.2f} m from its goal" if distance is not None else ""
        _say(f"{place} {name}: {row['end_reason']} at {row['robot_time_s']:.1f} s{left_off}")
    return died


def _folder(recordings: Path | None, episode: EpisodeConfig) -> Path | None:
    if recordings is None:
        return None
    return recordings / f"{episode.task.replace('/', '_')}-{episode.seed}"


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
