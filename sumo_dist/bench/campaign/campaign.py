"""A campaign: many trials in processes of their own, journalled so that it can be killed."""

import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.bench.campaign.job import Job, Row, common_settings, place, task_settings
from sumo_dist.bench.campaign.remote import trial_runners
from sumo_dist.bench.layout import check_at_least
from sumo_dist.bench.results.journal import Journal, Trial
from sumo_dist.bench.results.outcomes import recording_folder
from sumo_dist.bench.results.suites import SUITES
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.episode.settings_file import resolved
from sumo_dist.errors import SumoError, TaskError, UsageError, unknown
from sumo_dist.provenance import cores, provenance
from sumo_dist.services.router import RouterOptions
from sumo_dist.tasks import load_task, task_names
from sumo_dist.terminal import say


@dataclass(frozen=True, kw_only=True)
class TrialSettings:
    """Options of whatever runs trials: what decides them but task and seed, and who runs them.

    Attributes:
        preset: the planner's settings to start from: default or paper.
        optimizer: one of those of `sumo-dist list`; by default the preset's.
        settings: file of weights, parameters and planner settings, such as `sumo-dist tune` writes;
            what is said beside it wins.
        policy_file: a learned policy, from `sumo-dist train` or `sumo-dist distil`, drives in place
            of the planner; what --set says wins.
        set: planner settings as key=value; `sumo-dist list` names all.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
        time_limit: robot time per trial [s]; the tasks' own by default.
        jobs: trials at a time in this machine's processes; by default one for each core.
        listen: endpoint for `sumo-dist trial-worker` of other hosts, such as tls/0.0.0.0:7448;
            with it, jobs may be 0.
        keys: folder of this host's router from `sumo-dist keys host`, to listen with TLS.
        insecure: let anybody in without keys at a --listen beyond this machine.
        plant: nominal, perturbed or hard, see `sumo-dist run --help`.
        estimator: truth or lowpass.
        weight: weights of cost terms in place of the tasks', such as goal=80.
        param: the tasks' parameters, such as goal=1,0.
    """

    preset: str = "default"
    optimizer: str | None = None
    settings: Path | None = None
    policy_file: Path | None = None
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    engine: str = "auto"
    time_limit: float | None = None
    jobs: int | None = None
    listen: str | None = None
    keys: Path | None = None
    insecure: bool = False
    plant: str = "nominal"
    estimator: str = "truth"
    weight: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    param: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()

    def __post_init__(self) -> None:
        check_at_least(1 if self.listen is None else 0, jobs=self.jobs)
        _ = self.router  # its checks are these options', too

    @property
    def router(self) -> RouterOptions | None:
        """The router for trial workers, if there is to be one."""
        if self.listen is None:
            return None
        return RouterOptions(self.listen, keys=self.keys, insecure=self.insecure)

    def episode(self, task: str, seed: int) -> EpisodeConfig:
        """Return what decides a trial, checked."""
        return EpisodeConfig(
            task,
            seed,
            **resolved(
                *(load_task(task), self.settings, self.preset, self.optimizer),
                *(self.set, self.weight, self.param, self.policy_file),
            ),
            estimator=self.estimator,
            time_limit=self.time_limit,
            engine=self.engine,
            plant=self.plant,
        )


@dataclass(frozen=True, kw_only=True)
class Settings(TrialSettings):
    """Options of every bench that runs trials.

    Attributes:
        trials: seeds per task.
        seed0: the first seed.
    """

    trials: int = 20
    seed0: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least(1, trials=self.trials)

    @property
    def seeds(self) -> range:
        """The seeds of every task."""
        return range(self.seed0, self.seed0 + self.trials)


class Campaign:
    """Runs trials of some tasks and keeps their rows in a journal."""

    def __init__(
        self, settings: TrialSettings, trials: Sequence[Trial], path: Path, name: str = ""
    ) -> None:
        """Check everything that can be wrong before hours are spent, and read what is done.

        Args:
            settings: of all trials.
            trials: in the order they are run in.
            path: of the journal.
            name: tells it from those that are run beside it.

        Raises:
            UsageError: a setting is wrong, or the journal was made with other settings.
        """
        self.trials = trials
        self.name = name
        self._jobs = cores() if settings.jobs is None else settings.jobs
        self._router = settings.router
        self._episodes = {trial: settings.episode(trial.task, trial.seed) for trial in trials}
        self._common = common_settings(next(iter(self._episodes.values())))
        one_each = {episode.task: episode for episode in self._episodes.values()}
        self._of_task = {task: task_settings(episode) for task, episode in one_each.items()}
        self._journal = Journal(path, self._settings, say)
        self._about = {"provenance": provenance()}

    def run(self, recordings: Path | None = None) -> None:
        """Run what the journal lacks, and say how it goes.

        Args:
            recordings: folder that gets a recording of each of these trials.

        Raises:
            SumoError: the process of a trial died, or its task did not load there; all others
                were run.
        """
        for job, row in self._run_each(self._lacking(recordings)):
            self._note(job, row)

    @staticmethod
    def run_together(campaigns: Sequence["Campaign"]) -> None:
        """Run what the journals lack, each trial in all campaigns before the next trial.

        So whatever else the machine does meanwhile slows all of them alike.

        Args:
            campaigns: that differ in their names, their trials in the same order.

        Raises:
            SumoError: as of `run`.
        """
        first, named = campaigns[0], {campaign.name: campaign for campaign in campaigns}
        turns = {
            (campaign.name, trial): number
            for campaign in campaigns
            for number, trial in enumerate(campaign.trials)
        }
        todo = [job for campaign in campaigns for job in campaign._lacking()]
        todo.sort(key=lambda job: turns[job.cell, job.trial])
        for job, row in first._run_each(todo):
            named[job.cell]._note(job, row)

    def _lacking(self, recordings: Path | None = None) -> list[Job]:
        """Return what the journal lacks, and say how much it has."""
        todo = [
            self._job(trial, recording_folder(recordings, trial) if recordings else None)
            for trial in self.trials
            if trial not in self._journal.rows
        ]
        if done := len(self.trials) - len(todo):
            say(f"{self._journal.path} has {done} of {len(self.trials)} trials, {len(todo)} to go")
        return todo

    def _note(self, job: Job, row: Row) -> None:
        self._journal.append(row)
        say(f"{place(job)}: {ending(row)}")

    def record(self, trials: Iterable[Trial], recordings: Path) -> None:
        """Run finished trials again for the recordings that are not there yet.

        Raises:
            SumoError: a trial did not repeat to the last bit, or its process died.
        """
        todo = [
            self._job(trial, folder, self._journal.rows[trial]["state_digest"])
            for trial in trials
            if not ((folder := recording_folder(recordings, trial)) / "run.npz").exists()
        ]
        for job, _ in self._run_each(todo):
            say(f"{place(job)}: recorded in {job.folder}")

    def rows(self) -> list[Row]:
        """Rows of the trials that are done, in their order."""
        return [self._journal.rows[trial] for trial in self.trials if trial in self._journal.rows]

    def check_no_faults(self) -> None:
        """Say which trials say nothing about the planner.

        Raises:
            SumoError: some ended by a fault, such as a function of their task that raises.
        """
        rows = self.rows()
        faults = [row["end_reason"] for row in rows if row["end"] == End.FAULT.value]
        if faults:
            raise SumoError(f"{len(faults)} of {len(rows)} trials ended by a {faults[0]}")

    def _settings(self, trial: Trial) -> Row:
        return {**self._common, **self._of_task.get(trial.task, {})}

    def _job(self, trial: Trial, folder: Path | None, digest: str | None = None) -> Job:
        settings = {**trial._asdict(), **self._settings(trial), **self._about}
        return Job(trial, self._episodes[trial], settings, folder, digest, self.name)

    def _run_each(self, todo: Sequence[Job]) -> Iterable[tuple[Job, Row]]:
        """Yield jobs with their rows; recordings are made here, where their folder is."""
        began, died, refused = time.monotonic(), 0, list[TaskError]()
        router = None if any(job.folder for job in todo) else self._router
        build = self._common["engine_build"]
        with trial_runners(self._jobs, router if todo else None, build) as runners:
            for number, (job, row) in enumerate(runners.run_each(todo), 1):
                left = (time.monotonic() - began) / number * (len(todo) - number)
                sys.stderr.write(f"[{number}/{len(todo)}, {left / 60:.0f} min left] ")
                if row is None:
                    died += 1
                    say(f"{place(job)}: its process died")
                elif isinstance(row, TaskError):
                    refused.append(row)
                    say(f"{place(job)}: {row}")
                else:
                    yield job, row
        if refused:
            raise SumoError(f"{len(refused)} trials could not be run: {refused[0]}")
        if died:
            raise SumoError(
                f"the processes of {died} trials died (out of memory?); run again to repeat them"
            )


def named_tasks(text: str) -> list[str]:
    """Return the tasks that names mean: of tasks, files or suites, separated by commas.

    Raises:
        UsageError: there is no such task or suite, or a task's file is at fault.
    """
    found = dict[str, None]()
    for name in text.split(","):
        if name in SUITES:
            found |= dict.fromkeys(SUITES[name].figures)
        elif name in task_names() or name.endswith(".py"):
            found[load_task(name).source] = None
        else:
            raise unknown("task", name, ["/a/path/to/a/task.py", *SUITES, *task_names()])
    return [*found]


def make_folder(out: Path) -> None:
    """Make the folder of a campaign."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write to {out}: {error.strerror}") from None


def ending(row: Row) -> str:
    """Say how a trial ended."""
    distance = row["final_goal_distance_m"]
    left_off = f", object {distance:.2f} m from its goal" if distance is not None else ""
    return f"{row['end_reason']} at {row['robot_time_s']:.1f} s{left_off}"
