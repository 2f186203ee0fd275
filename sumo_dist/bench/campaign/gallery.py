"""`sumo-dist bench gallery`: a clip of every task and the page that shows them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import tyro

from sumo_dist.bench.layout import check_at_least
from sumo_dist.episode.ending import End
from sumo_dist.episode.scripting import run_episode
from sumo_dist.errors import UsageError, unknown
from sumo_dist.extras import need
from sumo_dist.provenance import provenance
from sumo_dist.record.recording import Recording
from sumo_dist.record.rows import Rows
from sumo_dist.tasks import load_task, task_names
from sumo_dist.tasks.spot.joints_upright import JOINTS_UPRIGHT
from sumo_dist.terminal import say
from sumo_dist.timing import TICK

Row = dict[str, Any]

FASTER = 2  # than the robot
_SIZE = 400, 225  # [pixels]
_QUALITIES = 45, 30, 20, 10  # of pictures: the first by which a clip is small enough
_MOST_BYTES = 350_000  # of a clip
_ROWS = "gallery.json"
_PAGE = "README.md"

HEAD = """# Gallery

Every task with the settings that it states, at {faster} times the robot's speed. Thin lines are
imagined futures coloured by their cost, those on the floor the ways of robot and object, rings the
goal. The seed is the first of 1, 2 and 3 that is solved; the last stands if none is. How often
tasks are solved is another question: [what was measured](../results/README.md).

`sumo-dist bench gallery` runs them all, draws them and writes this page. These are of {made_by}.
"""


@dataclass(frozen=True)
class Options:
    """Options of `bench gallery`.

    Attributes:
        task: names of those to run; by default all. Clips of others that are in the folder stay.
        out: folder that gets a clip of each task, gallery.json with how the runs ended, and the
            page, README.md.
        seeds: how many to try, from 1 on, until one is solved; the last is shown if none is.
        threads: of the rollouts; by default one for each core.
        time_limit: robot time [s]; the tasks' own by default.
    """

    task: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    out: Path = Path("docs/gallery")
    seeds: int = 3
    threads: int | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_at_least(1, seeds=self.seeds, threads=self.threads)
        for name in self.task:
            if name not in shown_tasks():
                raise unknown("task", name, shown_tasks())


def main(options: Options) -> int:
    """Run the tasks, draw them, write the page; 1 if one was not solved."""
    need("film", "the gallery")
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot write to {options.out}: {error.strerror}") from None
    kept = options.out / _ROWS
    rows: dict[str, Row] = json.loads(kept.read_text("utf-8")) if kept.exists() else {}
    for name in options.task or shown_tasks():
        recording, rows[name] = shown_run(name, options)
        clip(recording, options.out / rows[name]["clip"])
        rows = {name: rows[name] for name in shown_tasks() if name in rows}
        kept.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        (options.out / _PAGE).write_text(page(rows), encoding="utf-8")
        say(f"{name}, seed {rows[name]['seed']}: {rows[name]['ending']}")
    return 0 if all(rows[name]["ending"] == "success" for name in options.task or rows) else 1


def shown_tasks() -> list[str]:
    """Return the tasks of the gallery: all but those that nobody plans for."""
    return [name for name in task_names() if name not in JOINTS_UPRIGHT]


def shown_run(name: str, options: Options) -> tuple[Recording, Row]:
    """Run a task with one seed after the other until one is solved; return the last and its row."""

    def run(seed: int) -> Recording:
        threads, time_limit = options.threads, options.time_limit
        return run_episode(name, seed=seed, threads=threads, time_limit=time_limit)

    seed, recording = 1, run(1)
    while recording.ending != End.SUCCESS.value and seed < options.seeds:
        seed += 1
        recording = run(seed)
    row = {
        "seed": seed,
        "ending": recording.ending,
        "seconds": round((len(recording.states) - 1) * TICK, 2),
        "clip": f"{name.replace('/', '-')}.webp",
        **provenance(),
    }
    return recording, row


def faster(recording: Recording, times: int = FASTER) -> Recording:
    """Return a recording of which a film runs so many times as fast: of every so many ticks."""
    return replace(
        recording,
        states=Rows(recording.states[::times]),
        plan_ticks=Rows(recording.plan_ticks[:] // times),
    )


def clip(recording: Recording, path: Path) -> None:
    """Write a small film (.webp) of a recording."""
    from PIL import Image, ImageSequence

    from sumo_dist.view import replay

    with TemporaryDirectory(prefix="sumo-dist-") as folder:
        film = Path(folder) / path.name
        replay.render(faster(recording), film)
        with Image.open(film) as large:
            pictures = [
                (picture.convert("RGB").resize(_SIZE, Image.Resampling.LANCZOS), duration(picture))
                for picture in ImageSequence.Iterator(large)
            ]
    write(path, [picture for picture, _ in pictures], [shown for _, shown in pictures])


def write(path: Path, pictures: Sequence[Any], durations: Sequence[int]) -> None:
    """Write pictures, each shown so long [ms], as an animation of at most _MOST_BYTES.

    What is too large at any quality loses every second picture.
    """
    first, *others = pictures
    animation: dict[str, Any] = {"save_all": True, "append_images": others, "loop": 0, "method": 4}
    for quality in _QUALITIES:
        first.save(path, duration=list(durations), quality=quality, **animation)
        if path.stat().st_size < _MOST_BYTES:
            return
    if others:
        write(path, pictures[::2], [2 * shown for shown in durations[::2]])


def duration(picture: Any) -> int:
    """Return how long a picture of a film is shown [ms]."""
    picture.load()  # which is when it is known
    return int(picture.info["duration"])


def page(rows: dict[str, Row]) -> str:
    """Lay out the gallery as Markdown."""
    made_by = ", ".join(sorted({f"sumo-dist {row['sumo_dist']}" for row in rows.values()}))
    head = HEAD.format(faster=FASTER, made_by=made_by)
    robots = dict.fromkeys(name.partition("/")[0] for name in rows)
    return head + "".join(
        section(robot, [name for name in rows if name.startswith(f"{robot}/")], rows)
        for robot in robots
    )


def section(robot: str, names: Sequence[str], rows: dict[str, Row]) -> str:
    """Lay out the tasks of one robot."""
    lines = "".join(
        f"| ![{name}]({rows[name]['clip']}) | `{name}`: {about(name)}. {ended(rows[name])}. "
        f"`sumo-dist run {name} --seed {rows[name]['seed']}` |\n"
        for name in names
    )
    return f"\n## {robot.capitalize()}\n\n| clip | task |\n|---|---|\n{lines}"


def about(name: str) -> str:
    """Say what a task asks for, in one line."""
    return " ".join(load_task(name).description.split()).rstrip(".")


def ended(row: Row) -> str:
    """Say how a run ended, and after how long."""
    ending = "Solved" if row["ending"] == End.SUCCESS.value else f"Not solved ({row['ending']})"
    return f"{ending} after {row['seconds']:.1f} s"
