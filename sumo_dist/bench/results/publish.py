"""`sumo-dist bench report`: the folder of a suite as a web page and as a Markdown table."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.bench.results.outcomes import Results
from sumo_dist.bench.results.tables import text
from sumo_dist.errors import SumoError
from sumo_dist.extras import need
from sumo_dist.record.recording import Recording
from sumo_dist.record.rows import Rows
from sumo_dist.terminal import say


@dataclass(frozen=True)
class Options:
    """Options of `bench report`.

    Attributes:
        folder: that `bench suite` was run in.
    """

    folder: Annotated[Path, tyro.conf.Positional]


def main(options: Options) -> int:
    """Write report.md and report.html into the folder."""
    results = Results.load(options.folder)
    write(options.folder / "report.md", text(results))
    need("bench", "the page of a report")
    from sumo_dist.bench.results.page import page

    write(options.folder / "report.html", page(results, strips(results)))
    return 0


def write(path: Path, content: str) -> None:
    """Write a file and say so."""
    path.write_text(content, encoding="utf-8")
    print(f"wrote {path}")


def strips(results: Results) -> dict[str, bytes]:
    """Pictures (JPEG) of the typical trials whose recordings are there, by the recordings' names.

    They are kept beside the recordings.
    """
    pictures = {}
    for row in results.exemplars():
        folder = results.recording(row)
        picture = folder / "strip.jpg"
        if not (folder / "run.npz").exists():
            say(f"no recording of {row['task']} seed {row['seed']}; bench suite makes it")
            continue
        try:
            if not picture.exists():
                say(f"drawing {row['task']} seed {row['seed']}")
                draw(folder / "run.npz", picture)
        except SumoError as error:
            say(f"the page has no pictures: {error}")
            return {}
        pictures[folder.name] = picture.read_bytes()
    return pictures


def draw(recording: Path, picture: Path) -> None:
    """Write a strip of pictures of a recording, too small to show the candidates."""
    from sumo_dist.view import replay

    replay.render(replace(Recording.load(recording), traces=Rows()), picture)
