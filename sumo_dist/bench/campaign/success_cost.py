"""`sumo-dist bench success-cost`: CPU time per solved task against success, for any settings."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.bench.campaign.campaign import Settings
from sumo_dist.bench.campaign.cells import compare, parse_cells

CELLS = ("default,paper,reference",)  # that are compared if nothing else is asked for


@dataclass(frozen=True, kw_only=True)
class Options(Settings):
    """Options of `bench success-cost`.

    Attributes:
        tasks: names of tasks, files or suites, separated by commas.
        out: folder that gets a journal per cell; what was killed goes on from it.
        cell: planner settings to compare. Either names, separated by commas: default, paper,
            reference (Spot's search in the paper's released code, as near as ours comes, with the
            plant's own physics), and icem-16 and the like, an optimizer at 8, 16 or 32 rollouts.
            Or settings of your own as "NAME: key=value,key=value", where preset is a key too and
            optimizer brings what suits it. By default the first three.
        by_task: print a table of each task as well.
        trials: seeds per task, the same ones for every cell.
        set: planner settings of all cells as key=value; `sumo-dist list` names all.
    """

    tasks: str
    out: Path
    cell: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    by_task: bool = False
    trials: int = 10
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    # Cells say these.
    preset: tyro.conf.Suppress[str] = "default"
    optimizer: tyro.conf.Suppress[str | None] = None


def main(options: Options) -> int:
    """Run what the folder lacks and print the tables; 3 if a trial died or a fault ended it."""
    cells = parse_cells(options.cell or CELLS)
    return compare(options, cells, options.tasks, options.out, options.by_task)
