"""Runs a search: its episodes, its report, and in the end the winner against the task's own."""

from collections.abc import Sequence
from typing import Any, Self

from sumo_dist.bench.campaign.campaign import Campaign, ending, make_folder
from sumo_dist.bench.campaign.job import Job, common_settings, place, task_settings
from sumo_dist.bench.campaign.remote import trial_runners
from sumo_dist.bench.results.journal import Trial
from sumo_dist.bench.tune.folder import (
    CURVE,
    HELD_OUT,
    OWN,
    REPORT,
    WINNER,
    Folder,
    winner_name,
    write,
)
from sumo_dist.bench.tune.options import Options
from sumo_dist.bench.tune.picture import picture
from sumo_dist.bench.tune.report import Found, text
from sumo_dist.bench.tune.results import RUNNING, STATES, Tried, best
from sumo_dist.bench.tune.search import Question, Search
from sumo_dist.bench.tune.space import Space
from sumo_dist.episode.ending import End
from sumo_dist.episode.settings_file import SettingsFile
from sumo_dist.errors import SumoError, TaskError, UsageError
from sumo_dist.provenance import cores, provenance
from sumo_dist.signals import uninterrupted
from sumo_dist.terminal import say


class Tuning:
    """One search and its folder; a context manager that writes the report and closes the folder."""

    def __init__(self, options: Options, space: Space) -> None:
        """Open the folder, and go on from what is there.

        Raises:
            UsageError: the folder holds another search, or something else.
        """
        self._options, self._space = options, space
        self._request = options.request(space)
        self._folder = Folder(options.folder, self._request)
        found = self._folder.trials
        if found:
            say(f"{self._folder.path} has {_counted(found)}; it goes on")
        self._search = Search(
            *(space, options.seeds_tried, options.first, options.trials, options.seed),
            own=options.start == "own",
            found=found,
        )
        self._about = {"provenance": provenance()}
        self._running = dict[str, Question]()  # by the names of their jobs

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with uninterrupted():
            try:
                self.report()
            finally:
                self._folder.close()

    def run(self) -> None:
        """Run what is missing, and compare the winner with the task's own values.

        Raises:
            SumoError: a trial's process died, or all its episodes ended by faults; all that had
                ended before is kept.
        """
        options = self._options
        jobs = cores() if options.jobs is None else options.jobs
        build = self._request["decides"]["engine_build"]
        if first := self._next_job():
            waiting = [first]
            with trial_runners(jobs, options.router, build) as runners:
                for job, row in runners.run_asked(
                    lambda: waiting.pop() if waiting else self._next_job()
                ):
                    self._take(job, row)
        self._compare()

    def report(self) -> None:
        """Write what there is: the report, the picture, the winner's file."""
        folder, trials = self._folder.path, self._folder.trials
        found = Found(str(folder), self._request, trials, self._search.importances())
        write(folder / CURVE, picture([found]))
        write(folder / REPORT, text([found], CURVE))
        if winner := best(trials):
            write(folder / WINNER, self._settings_file(winner).toml)

    @property
    def found(self) -> str:
        """What there is, in a line."""
        folder, winner = self._folder.path, best(self._folder.trials)
        if winner is None:
            return f"no trial was run to its end; see {folder / REPORT}"
        return (
            f"trial {winner.number} solved {winner.solved} of {len(winner.rows)} seeds; how it "
            f"does on others is in {folder / REPORT}; to use it: "
            f"sumo-dist run {self._options.task} --settings {folder / WINNER}"
        )

    def _next_job(self) -> Job | None:
        while question := self._search.next():
            try:
                job = self._job(question)
            except UsageError as error:
                say(f"trial {question.number} is left out: {error}")
                self._search.drop(question)
                continue
            self._running[job.cell] = question
            return job
        return None

    def _job(self, question: Question) -> Job:
        source = self._space.task.source
        episode = self._space.with_values(question.values).episode(source, question.seed)
        trial = Trial(episode.task, episode.seed)
        settings = {**trial._asdict(), **common_settings(episode), **task_settings(episode)}
        return Job(trial, episode, {**settings, **self._about}, cell=f"trial {question.number}")

    def _take(self, job: Job, row: Any) -> None:
        """Take what came of a job."""
        if row is None:
            raise SumoError(
                f"the process of {place(job)} died (out of memory?); the same command goes on"
            )
        if isinstance(row, TaskError):
            raise row
        question = self._running.pop(job.cell)
        state = self._search.take(question, row)
        of_trial = {"trial": question.number, "values": question.values, "asked": question.asked}
        with uninterrupted():
            self._folder.append({**row, **of_trial, "state": state})
        say(f"{place(job)}: {ending(row)}")
        if state != RUNNING:
            self._note(question.number)

    def _note(self, number: int) -> None:
        """Say what a trial that has ended came to, and write what there is."""
        trials = self._folder.trials
        trial, winner = next(t for t in trials if t.number == number), best(trials)
        best_now = f"; best: trial {winner.number}, {winner.loss:.3f}" if winner else ""
        values = ", ".join(f"{name} {value}" for name, value in trial.values.items())
        of_all = f"{sum(t.state != RUNNING for t in trials)}/{self._options.trials}"
        say(f"[{of_all}] trial {number} {trial.state}: loss {trial.loss:.3f} of {values}{best_now}")
        if all(row["end"] == End.FAULT.value for row in trial.rows):
            raise SumoError(f"all of trial {number} ended by a {trial.rows[0]['end_reason']}")
        with uninterrupted():
            self.report()

    def _compare(self) -> None:
        """Run the winner and the task's own values on seeds that the search has not seen."""
        winner, seeds = best(self._folder.trials), self._options.seeds_held_out
        if winner is None or not seeds or winner.values == self._space.start:
            return
        trials = [Trial(self._space.task.source, seed) for seed in seeds]
        folder = self._folder.path / HELD_OUT
        make_folder(folder)
        cells = {
            OWN: self._space.fixed,
            winner_name(winner): self._space.with_values(winner.values),
        }
        Campaign.run_together(
            [Campaign(given, trials, folder / f"{n}.jsonl", n) for n, given in cells.items()]
        )

    def _settings_file(self, winner: Tried) -> SettingsFile:
        task = self._space.task
        episode = self._space.with_values(winner.values).episode(task.source, 0)
        origin = {
            "command": self._request["command"],
            "trial": winner.number,
            "loss": round(winner.loss, 4),
            "solved": f"{winner.solved} of {len(winner.rows)} seeds",
            "seeds": self._options.seeds_tried,
            **{key: self._about["provenance"][key] for key in ("sumo_dist", "machine")},
        }
        return SettingsFile.of(task, episode.planner, episode.cost(task), origin)


def _counted(trials: Sequence[Tried]) -> str:
    counts = [(state, sum(t.state == state for t in trials)) for state in STATES]
    return "trials: " + ", ".join(f"{n} {state}" for state, n in counts if n)
