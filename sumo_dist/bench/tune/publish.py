"""`sumo-dist bench tune-report`: one or several searches of a task on a page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.bench.tune.folder import write
from sumo_dist.bench.tune.report import Found, text
from sumo_dist.errors import UsageError
from sumo_dist.extras import need
from sumo_dist.terminal import say


@dataclass(frozen=True)
class Options:
    """Options of `bench tune-report`.

    Attributes:
        folders: of `sumo-dist tune`, of the same task.
        out: the page, a file NAME.md; its picture is NAME.svg beside it.
    """

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    out: Path


def main(options: Options) -> int:
    """Write the page and its picture, of what there is."""
    need("tune", "the picture of a search")
    from sumo_dist.bench.tune.picture import picture

    if not options.folders:
        raise UsageError("name one or more folders of `sumo-dist tune`")
    if options.out.suffix != ".md":
        raise UsageError(f"out must be a file NAME.md, got {options.out}")
    searches = [Found.load(folder) for folder in options.folders]
    tasks = dict.fromkeys(found.request["task"] for found in searches)
    if len(tasks) > 1:
        raise UsageError(f"these are searches of different tasks: {', '.join(tasks)}")
    image = options.out.with_suffix(".svg")
    write(image, picture(searches))
    write(options.out, text(searches, image.name))
    say(f"{options.out} and {image}")
    return 0
