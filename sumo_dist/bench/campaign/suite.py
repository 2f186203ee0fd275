"""`sumo-dist bench suite`: a set of tasks, many seeds each, in a folder that can be reported on."""

import json
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from sumo_dist.bench.campaign.campaign import Campaign, Settings, make_folder
from sumo_dist.bench.layout import spelled
from sumo_dist.bench.results.journal import STANDING, Trial
from sumo_dist.bench.results.outcomes import JOURNAL, RECORDINGS, REQUEST, Results
from sumo_dist.bench.results.suites import SUITES, Suite
from sumo_dist.bench.results.tables import table
from sumo_dist.errors import UsageError, unknown
from sumo_dist.terminal import say


@dataclass(frozen=True, kw_only=True)
class Options(Settings):
    """Options of `bench suite`.

    Attributes:
        suite: its name: paper-analysis, paper-spot or paper-g1.
        out: folder for the journal and the recordings; a suite that was killed goes on from it.
        tasks: only these tasks of the suite, separated by commas.
        recordings: ends keeps, per task, the success of median time and a failure, which are run
            again for it and must repeat to the last bit; all keeps every trial (some 5 MB each).
    """

    suite: Annotated[str, tyro.conf.Positional]
    out: Path
    tasks: str | None = None
    recordings: Literal["ends", "all", "none"] = "ends"

    def chosen(self) -> tuple[Suite, list[str]]:
        """Return the suite and its chosen tasks, checked."""
        if self.suite not in SUITES:
            raise unknown("suite", self.suite, SUITES)
        suite = SUITES[self.suite]
        tasks = list(suite.figures) if self.tasks is None else self.tasks.split(",")
        for task in tasks:
            if task not in suite.figures:
                raise unknown(f"task of {suite.name}", task, suite.figures)
        return suite, tasks


def main(options: Options) -> int:
    """Run what the folder lacks and print the table; 3 if a trial died or ended by a fault."""
    suite, tasks = options.chosen()
    trials = [
        Trial(task, seed, variant)
        for seed in options.seeds  # task by task within a seed: an unfinished suite has seen all
        for variant, of_it in (("planned", tasks), (STANDING, suite.controls))
        for task in of_it
        if task in tasks
    ]
    make_folder(options.out)
    _check_same_suite(options.out, suite)
    campaign = Campaign(options, trials, options.out / JOURNAL)
    _write_request(options, suite, tasks)
    recordings = options.out / RECORDINGS
    campaign.run(recordings if options.recordings == "all" else None)
    results = Results.load(options.out)
    if options.recordings != "none":
        wanted = results.rows if options.recordings == "all" else results.exemplars()
        campaign.record((Trial.of(row) for row in wanted), recordings)
    print(table(results))
    campaign.check_no_faults()
    say(f"for the page: sumo-dist bench report {shlex.quote(str(options.out))}")
    return 0


def command(options: Options) -> str:
    """Return the command line that asks for the same."""
    return spelled("bench suite", options, "suite")


def _check_same_suite(out: Path, suite: Suite) -> None:
    request = out / REQUEST
    if request.exists() and (found := json.loads(request.read_text()).get("suite")) != suite.name:
        raise UsageError(f"{out} holds the suite {found}; name another folder")


def _write_request(options: Options, suite: Suite, tasks: list[str]) -> None:
    """Note what was asked for, for the report."""
    request = {"suite": suite.name, "command": command(options), "tasks": tasks}
    request |= {"trials": options.trials, "seed0": options.seed0}
    partial = options.out / f"{REQUEST}.part"
    partial.write_text(json.dumps(request, indent=2) + "\n", encoding="utf-8")
    partial.replace(options.out / REQUEST)
