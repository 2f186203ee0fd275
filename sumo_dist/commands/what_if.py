"""`sumo-dist replay --what-if`: another future of a recorded run."""

from pathlib import Path

from sumo_dist.episode.again import Change, what_if
from sumo_dist.episode.ending import End
from sumo_dist.episode.outcome import outcome, weights_at
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.summary import keep
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.record.folders import RECORDING, run_folder
from sumo_dist.record.recording import Recording
from sumo_dist.signals import uninterrupted
from sumo_dist.terminal import say
from sumo_dist.timing import TICK

_RUN = "run"  # key of the folder that another future has branched off


def asked(
    recording: Recording,
    begin: float | None,
    weight: tuple[str, ...],
    param: tuple[str, ...],
    settings: tuple[str, ...],
    seed: int | None,
    time_limit: float | None,
) -> Change:
    """Return what is to be other, and from which tick on.

    Raises:
        UsageError: the instant is none of the run's.
    """
    last = (len(recording.states) - 1) * TICK
    if begin is None:
        raise UsageError(f"from when? give --what-if --from SECONDS, from 0 to {last:g}")
    if not 0 <= begin <= last + TICK / 2:
        raise UsageError(f"there is no {begin:g} s in this run; valid: --from 0 to {last:g}")
    return Change(round(begin / TICK), weight, param, settings, seed, time_limit)


def futures(
    recording: Recording, folder: Path, change: Change, out: Path | None, threads: int
) -> tuple[Recording, Path]:
    """Plan again, write the new future, print what came of both; return it and its folder."""
    folder = folder if folder.name not in ("", "..") else folder.resolve()  # "." has no neighbour
    default = folder.with_name(f"{folder.name}-what-if")
    if out is not None and out.resolve() == folder.resolve():
        raise UsageError(f"--out {out} is the run itself: give the new future another folder")
    with run_folder(out, default) as new:
        again, ending = what_if(
            recording, change, threads, Progress(recording.config["terms"], say)
        )
        again.config["what_if"][_RUN] = str(folder.absolute())
        with uninterrupted():
            keep(again, ending, new)
    if ending.kind is End.INTERRUPTED:
        raise KeyboardInterrupt
    weights = weights_at(recording, change.tick)
    changed = ", ".join(change.words) or "nothing"
    print(f"from {change.tick * TICK:g} s on, changed: {changed}")
    print(f"recorded: {outcome(recording, change.tick, weights)}")
    print(f"what if:  {outcome(again, change.tick, weights)}")
    print(f"the new future is in {new}")
    return again, new


def recorded_future(recording: Recording, folder: Path) -> tuple[Recording, int] | None:
    """Return the run that a what-if has branched off, if it is still there, and at which tick."""
    origin = recording.config.get("what_if")
    if origin is None:
        return None
    before = Path(origin.get(_RUN, ""))
    places = before, folder.resolve().parent / before.name  # or both were moved
    for place in places:
        try:
            found = Recording.load(place / RECORDING)
        except SumoError:
            continue
        if found.state_digest == origin["state_digest"]:
            return found, int(origin["tick"])
    return None
