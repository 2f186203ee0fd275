"""`sumo-dist replay`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from sumo_dist.errors import UsageError
from sumo_dist.record.recording import Recording


@dataclass(frozen=True)
class Options:
    """Options of `replay`.

    Attributes:
        run: folder that a run was written to.
        viewer: show it in Rerun: native or web.
        render: write a film to this file instead, .mp4 or .gif, or a strip of pictures, .jpg.
    """

    run: Annotated[Path, tyro.conf.Positional]
    viewer: str = "web"
    render: Path | None = None


def main(options: Options) -> int:
    """Show or render."""
    recording = Recording.load(options.run / "run.npz")
    from sumo_dist.view import replay  # needs the view extra

    if options.render is not None:
        if options.render.suffix not in replay.FILMS:
            valid = ", ".join(replay.FILMS)
            raise UsageError(f"cannot render {options.render.name}; valid endings: {valid}")
        replay.render(recording, options.render)
        print(f"wrote {options.render}")
    elif (trace := options.run / "run.rrd").exists():  # has the candidates of a distributed run
        replay.show_file(trace, options.viewer)
    else:
        replay.show(recording, options.viewer)
    return 0
