"""Tables of a recording on disk: CSV with its units beside it, or Parquet with its units inside."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from sumo_dist.export.columns import Column, plans_table, ticks_table
from sumo_dist.extras import need
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World

TABLES = {"": ticks_table, ".plans": plans_table}


def write_tables(recording: Recording, path: Path) -> list[Path]:
    """Write one table of ticks, and beside it one of plans.

    Args:
        recording: what to write.
        path: of the ticks, .csv or .parquet; the plans' is NAME.plans.csv or NAME.plans.parquet.

    Returns:
        The files: with .csv also NAME.units.json, which says of each column what it is.

    Raises:
        SumoError: Parquet needs the `export` extra.
    """
    if path.suffix == ".parquet":
        need("export", "a Parquet file")
    world = World.of(recording)
    tables = {
        path.with_name(f"{path.stem}{kind}{path.suffix}"): make(recording, world)
        for kind, make in TABLES.items()
    }
    for file, columns in tables.items():
        (_write_parquet if path.suffix == ".parquet" else _write_csv)(file, columns, recording)
    if path.suffix == ".parquet":
        return [*tables]
    units = path.with_name(f"{path.stem}.units.json")
    about = {
        file.name: {column.name: {"unit": column.unit, "about": column.about} for column in columns}
        for file, columns in tables.items()
    }
    units.write_text(json.dumps(about, indent=1) + "\n")
    return [*tables, units]


def _write_csv(path: Path, columns: Sequence[Column], recording: Recording) -> None:
    del recording
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([column.name for column in columns])
        writer.writerows(zip(*(column.values.tolist() for column in columns), strict=True))


def _write_parquet(path: Path, columns: Sequence[Column], recording: Recording) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = [pa.array(column.values) for column in columns]
    fields = [
        pa.field(column.name, array.type, metadata={"unit": column.unit, "about": column.about})
        for column, array in zip(columns, arrays, strict=True)
    ]
    about = {"sumo-dist": json.dumps(recording.config), "ending": recording.ending}
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, about)), path)
