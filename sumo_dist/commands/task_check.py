"""`sumo-dist task check`: is a task fit to be planned for, before hours are spent on it."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from sumo_dist.check.checks import findings
from sumo_dist.check.subject import Subject
from sumo_dist.errors import UsageError
from sumo_dist.tasks import load_task

VERDICTS = {"ok": "ok", "warn": "warn", "fail": "FAIL", "skip": "-"}


@dataclass(frozen=True)
class Options:
    """Options of `task check`.

    Attributes:
        task: a name, or the path of a file that defines task() -> Task.
        seeds: how many starts are drawn.
    """

    task: Annotated[str, tyro.conf.Positional]
    seeds: int = 5


def main(options: Options) -> int:
    """Print the cost table and a line per check; 0 if all are ok, else 1."""
    if not 2 <= options.seeds <= 1000:
        raise UsageError(f"seeds must be from 2 to 1000, got {options.seeds}")
    subject = Subject(load_task(options.task), options.seeds)
    print(f"{subject.task}\n")
    good = True
    for name, finding in findings(subject):
        good &= finding.level == "ok"
        print(f"{VERDICTS[finding.level]:<6}{name:<12}{finding.text}", flush=True)
    return 0 if good else 1
