"""`sumo-dist export`: recordings in formats that other programs read."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.record.folders import RECORDING
from sumo_dist.record.recording import Recording

ENDINGS = (".csv", ".mcap", ".parquet")


@dataclass(frozen=True)
class Options:
    """Options of `export`.

    Attributes:
        runs: folders that runs were written to; a dataset may have several, a file one.
        to: what to write. FILE.mcap, for Foxglove and its like; FILE.csv or FILE.parquet, tables of
            ticks and of plans; or, without an ending, a new folder: a dataset in LeRobot's format.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    to: Path


def main(options: Options) -> int:
    """Write the file or the dataset."""
    to = options.to
    if to.suffix not in (*ENDINGS, ""):
        valid = ", ".join(ENDINGS)
        raise UsageError(
            f"cannot export to {to.name}; valid endings: {valid}, or none: a folder for a dataset"
        )
    if not options.runs:
        raise UsageError("name the folder of a run: sumo-dist export RUN --to FILE")
    if to.suffix and len(options.runs) > 1:
        raise UsageError(f"{to.name} has room for one run; a dataset, a folder, has it for several")
    runs = {str(run): Recording.load(_file(run)) for run in options.runs}
    try:
        to.parent.mkdir(parents=True, exist_ok=True)
        _export(runs, to)
    except OSError as error:
        raise SumoError(f"cannot write to {to}: {error.strerror or error}") from None
    return 0


def _export(runs: dict[str, Recording], to: Path) -> None:
    recording = next(iter(runs.values()))
    if not to.suffix:
        from sumo_dist.export.lerobot import VERSION, write_dataset

        frames = write_dataset(runs, to)
        print(f"wrote {to}: {len(runs)} episodes, {frames} frames, LeRobot {VERSION} without video")
    elif to.suffix == ".mcap":
        from sumo_dist.export.mcap_file import write_mcap

        write_mcap(recording, to)
        print(f"wrote {to}")
    else:
        from sumo_dist.export.table_files import write_tables

        print(f"wrote {', '.join(map(str, write_tables(recording, to)))}")


def _file(run: Path) -> Path:
    return run if run.name == RECORDING else run / RECORDING
