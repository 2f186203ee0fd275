"""`sumo-dist replay`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from sumo_dist.episode.single import repeat
from sumo_dist.errors import UsageError
from sumo_dist.record.folders import RECORDING, RUNS, newest_run
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import unchanged_task
from sumo_dist.terminal import say


@dataclass(frozen=True)
class Options:
    """Options of `replay`.

    Attributes:
        run: folder that a run was written to; by default the newest below runs/.
        viewer: show it in Rerun: native or web.
        render: write a film to this file instead, .mp4, .gif or .webp, or a strip of pictures as
            .jpg.
        save: write what the viewer shows to this file instead, .rrd.
        repeat: run it again in this process, with the commands that it was given, and say whether
            plans and states are the same to the last bit.
    """

    run: Annotated[Path | None, tyro.conf.Positional] = None
    viewer: str = "web"
    render: Path | None = None
    save: Path | None = None
    repeat: bool = False


def main(options: Options) -> int:
    """Show, render, save or repeat."""
    folder = options.run or _newest()
    if folder.name == RECORDING:
        folder = folder.parent
    recording = Recording.load(folder / RECORDING)
    if options.repeat:
        unchanged_task(recording)
        return _repeat(recording)
    from sumo_dist.view import replay

    if options.render is not None:
        if options.render.suffix not in replay.FILMS:
            valid = ", ".join(replay.FILMS)
            raise UsageError(f"cannot render {options.render.name}; valid endings: {valid}")
        replay.render(recording, _in_its_folder(options.render))
        print(f"wrote {options.render}")
    elif options.save is not None:
        if options.save.suffix != ".rrd":
            raise UsageError(f"cannot save {options.save.name}; valid endings: .rrd")
        replay.to_rrd(recording, _in_its_folder(options.save))
        print(f"wrote {options.save}")
    elif (trace := folder / "run.rrd").exists():  # has the candidates of a distributed run
        replay.show_file(trace, options.viewer)
    else:
        replay.show(recording, options.viewer)
    return 0


def _newest() -> Path:
    folder = newest_run(RUNS)
    if folder is None:
        raise UsageError(f"no run below {RUNS.absolute()}: name the folder of one")
    say(f"the newest run: {folder}")
    return folder


def _in_its_folder(path: Path) -> Path:
    """Make the folder of a file that is to be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write to {path.parent}: {error.strerror}") from None
    return path


def _repeat(recording: Recording) -> int:
    """Return 0 if the recording repeats to the last bit, 1 if not."""
    again = repeat(recording)
    plans, states = len(recording.plan_numbers), len(recording.states)
    digests = recording.plan_digest, recording.state_digest
    numbers = all(
        plans == 0 or np.array_equal(getattr(recording, name), getattr(again, name))
        for name in ("weights", "parameters")
    )
    if numbers and (again.plan_digest, again.state_digest) == digests:
        print(f"{plans} plans and {states} states repeat to the last bit")
        return 0
    print(f"{plans} plans and {states} states do not repeat: {_first_difference(recording, again)}")
    return 1


def _first_difference(one: Recording, other: Recording) -> str:
    """Say where two recordings part."""
    for tick, (before, now) in enumerate(zip(one.states, other.states, strict=False)):
        if not np.array_equal(before, now):
            return f"the states differ from tick {tick} on"
    if len(one.states) != len(other.states):
        return f"there are {len(other.states)} states"
    return "the states are the same; plans, weights or parameters are not"
