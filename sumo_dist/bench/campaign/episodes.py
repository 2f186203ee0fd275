"""`sumo-dist bench episodes`: many seeds of some tasks, counted."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sumo_dist.bench.campaign.campaign import Campaign, Settings, named_tasks
from sumo_dist.bench.layout import markdown
from sumo_dist.bench.results.journal import Trial
from sumo_dist.bench.results.outcomes import CELLS, count_tasks


@dataclass(frozen=True, kw_only=True)
class Options(Settings):
    """Options of `bench episodes`.

    Attributes:
        tasks: names of tasks, files or suites, separated by commas.
        out: file that gets one JSON object per trial; a campaign that was killed goes on from it.
        recordings: folder that gets each trial's recording, for `sumo-dist replay`.
    """

    tasks: str
    out: Path
    recordings: Path | None = None


def main(options: Options) -> int:
    """Run what the file lacks, print the table; 3 if a trial's process died or a fault ended it."""
    trials = [Trial(task, seed) for task in named_tasks(options.tasks) for seed in options.seeds]
    campaign = Campaign(options, trials, options.out)
    campaign.run(options.recordings)
    print(table(campaign.rows()))
    campaign.check_no_faults()
    return 0


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Lay out the successes of each task."""
    counts = count_tasks(rows).values()
    lines = [(count.task, *count.cells(), count.ended_by()) for count in counts]
    return markdown(("task", *CELLS, "ended by"), lines)
