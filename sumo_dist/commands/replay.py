"""`sumo-dist replay`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from sumo_dist.commands.what_if import asked, futures, recorded_future
from sumo_dist.episode.again import repeat
from sumo_dist.episode.difference import first_difference
from sumo_dist.errors import Interrupted, SumoError, UsageError, unknown
from sumo_dist.planner.report import PlanReport
from sumo_dist.provenance import cores
from sumo_dist.record.folders import RECORDING, RUNS, newest_run
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World, changed_versions
from sumo_dist.terminal import say

_VIEWERS = ("web", "native", "none")


@dataclass(frozen=True)
class Options:
    """Options of `replay`.

    Attributes:
        run: folder that a run was written to; by default the newest below runs/.
        viewer: show it in Rerun: native or web; none shows nothing.
        render: write a film to this file instead, .mp4, .gif or .webp, or a strip of pictures as
            .jpg.
        save: write what the viewer shows to this file instead, .rrd.
        verify: run it again in this process, with the commands that it was given, and say whether
            plans and states are the same to the last bit, or where they first differ.
        what_if: plan again in this process, from --from on, with the numbers below; writes the new
            future as a run of its own and shows both.
        begin: robot time from which --what-if plans again [s].
        weight: with --what-if, weights of cost terms as name=number.
        param: with --what-if, the task's parameters as name=number or name=number,number.
        set: with --what-if, planner settings as key=value.
        seed: with --what-if, of the planner's noise from then on.
        time_limit: with --what-if, of the whole run, robot time [s].
        out: with --what-if, folder of the new future; by default a new one beside the run.
        threads: of the rollouts of --verify and --what-if; by default one for each core.
    """

    run: Annotated[Path | None, tyro.conf.Positional] = None
    viewer: str = "web"
    render: Path | None = None
    save: Path | None = None
    verify: bool = False
    what_if: bool = False
    begin: Annotated[float | None, tyro.conf.arg(name="from")] = None
    weight: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    param: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    seed: int | None = None
    time_limit: float | None = None
    out: Path | None = None
    threads: int | None = None


def main(options: Options) -> int:
    """Show, render, save, verify or plan again."""
    _check(options)
    folder = options.run or _newest()
    if folder.name == RECORDING:
        folder = folder.parent
    recording = Recording.load(folder / RECORDING)
    threads = cores() if options.threads is None else options.threads
    if options.verify:
        return _verify(recording, threads)
    other = recorded_future(recording, folder)
    if options.what_if:
        change = asked(
            recording,
            options.begin,
            options.weight,
            options.param,
            options.set,
            options.seed,
            options.time_limit,
        )
        other, (recording, folder) = (
            (recording, change.tick),
            futures(recording, folder, change, options.out, threads),
        )
    _see(options, recording, folder, other)
    return 0


def _see(
    options: Options, recording: Recording, folder: Path, other: tuple[Recording, int] | None
) -> None:
    """Show, render or save a recording, beside the one that it has branched off."""
    from sumo_dist.view import replay

    if options.render is not None:
        replay.render(recording, _in_its_folder(options.render), other)
        print(f"wrote {options.render}")
    elif options.save is not None:
        replay.to_rrd(recording, _in_its_folder(options.save), other=other)
        print(f"wrote {options.save}")
    elif options.viewer == "none":
        return
    elif (trace := folder / "run.rrd").exists():  # has the candidates of a distributed run
        replay.show_file(trace, options.viewer)
    else:
        replay.show(recording, options.viewer, other)


def _check(options: Options) -> None:
    """Raise what is wrong with options that do not fit together, before anything is computed."""
    if options.viewer not in _VIEWERS:
        raise unknown("viewer", options.viewer, _VIEWERS)
    if options.verify and options.what_if:
        raise UsageError("--verify repeats a run, --what-if changes it: give one of them")
    if options.threads is not None and not 1 <= options.threads <= 256:
        raise UsageError(f"threads must be from 1 to 256, got {options.threads}")
    names = ("begin", "weight", "param", "set", "seed", "time_limit", "out")
    for name in names:
        if not options.what_if and getattr(options, name) not in (None, ()):
            option = "from" if name == "begin" else name.replace("_", "-")
            raise UsageError(f"--{option} is of another future: give --what-if --from SECONDS too")
    if options.render is not None and options.save is not None:
        raise UsageError("--render writes a film, --save an .rrd: give one of them")
    if options.render is not None:
        from sumo_dist.view.replay import FILMS

        if options.render.suffix not in FILMS:
            valid = ", ".join(FILMS)
            raise UsageError(f"cannot render {options.render.name}; valid endings: {valid}")
    if options.save is not None and options.save.suffix != ".rrd":
        raise UsageError(f"cannot save {options.save.name}; valid endings: .rrd")


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


def _verify(recording: Recording, threads: int) -> int:
    """Return 0 if a recording repeats to the last bit, 3 if not."""
    world = World.of(recording)
    again = repeat(recording, threads, _Watch(recording))
    plans, states = len(recording.plan_numbers), len(recording.states)
    difference = first_difference(recording, again, world)
    ended_otherwise = recording.ending and again.ending != recording.ending
    if difference is None and not ended_otherwise:
        lost = int(np.count_nonzero(recording.lost)) if plans else 0
        taken = f" ({lost} that lost candidates were taken as they are)" if lost else ""
        print(f"{plans} plans{taken} and {states} states repeat to the last bit")
        return 0
    end = f"the end was {recording.ending!r} and is {again.ending!r} now"
    print(
        f"{plans} plans and {states} states do not repeat: {difference.text if difference else end}"
    )
    if changed := changed_versions(recording):
        print(f"since then: {'; '.join(changed)}")
    return SumoError.exit_code


class _Watch:
    """Ends a repeated run after the first plan that is another: all that follow would be, too."""

    def __init__(self, recording: Recording) -> None:
        numbers = map(int, recording.plan_numbers)
        self._knots, self._parted = dict(zip(numbers, recording.knots, strict=True)), False

    def __call__(self, report: PlanReport) -> None:
        if self._parted:
            raise Interrupted("the plans have parted")
        before = self._knots.get(report.plan.number)
        self._parted = before is None or before.tobytes() != report.plan.knots.tobytes()
