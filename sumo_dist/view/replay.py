"""A recording for people: as a Rerun file, in a viewer, as a film."""

import os
import subprocess
import sys
from collections import deque
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError, unknown
from sumo_dist.extras import need
from sumo_dist.record.recording import Recording
from sumo_dist.record.reports import reports
from sumo_dist.record.world import World

if TYPE_CHECKING:
    from sumo_dist.view.futures import OtherFuture
    from sumo_dist.view.outputs import Outputs
    from sumo_dist.view.run_logger import RunLogger
    from sumo_dist.view.viewers import Viewer

Other = tuple[Recording, int]
"""Another future of the same run, and the tick from which on it is another."""

FILMS = (".gif", ".jpg", ".mp4", ".webp")
STRIP = 6  # pictures in a strip
NO_GRAPHICS = 10  # exit code of the drawing process when there is nothing to draw with
REPLAY_MEMORY = "1GB"  # of a recording that is shown while it is read
CANDIDATES_LIMIT = 60_000_000  # [bytes]


def episode(recording: Recording) -> EpisodeConfig:
    """Return what decided a recorded episode."""
    return EpisodeConfig.of(recording.config.get("episode"))


def to_rrd(
    recording: Recording,
    path: Path,
    candidates_limit: int = CANDIDATES_LIMIT,
    other: Other | None = None,
) -> None:
    """Write a recording as a Rerun file of bounded size.

    Args:
        recording: of any length.
        path: of the .rrd.
        candidates_limit: in a longer run, the candidates of only every so many plans are drawn
            [bytes].
        other: the future that is drawn beside it.

    Raises:
        SumoError: the file cannot be written, or the `view` extra is not installed.
    """
    need("view", "Rerun's file of a run")
    from sumo_dist.view.outputs import Outputs
    from sumo_dist.view.rrd_file import RrdFile

    troubles = list[str]()
    size = sum(traces.nbytes for traces in recording.traces)
    with Outputs(path.parent.name, RrdFile(path, troubles.append)) as out:
        _log(recording, out, other, stride=max(1, -(-size // candidates_limit)))
    if troubles:
        raise SumoError(troubles[0])


def _log(recording: Recording, out: "Outputs", other: Other | None = None, stride: int = 1) -> None:
    """Log a recording in the order of time, the candidates of every `stride`-th plan."""
    from sumo_dist.view.futures import OtherFuture, plots_of
    from sumo_dist.view.run_logger import RunLogger

    config = episode(recording)
    world = World.of(recording)
    also = plots_of(recording) if other else ()
    with closing(
        RunLogger(out, world.task, config, distributed=False, model=world.model, also=also)
    ) as logger:
        beside = OtherFuture(out, world, recording, *other) if other else None
        _log_run(recording, logger, beside, stride)
        for tick in range(len(recording.states), len(other[0].states) if other else 0):
            assert beside is not None, "there is another one"
            beside.log(tick)


def _log_run(
    recording: Recording, logger: "RunLogger", beside: "OtherFuture | None", stride: int
) -> None:
    plans = deque(enumerate(reports(recording)))
    for tick, state in enumerate(recording.states):
        logger.log_state(tick, state)
        if beside is not None:
            beside.log(tick)
        while plans and plans[0][1].plan.tick <= tick:
            i, report = plans.popleft()
            logger.log_plan(report)
            if i % stride == 0 and recording.seen(i):
                logger.log_candidates(tick, recording.costs[i], recording.traces[i])
            logger.log_ghost(report, tick, recording.estimates[tick], recording.memories[tick])
    last = len(recording.states) - 1
    ending = f"the run has ended: {recording.ending}" if recording.ending else "it ends here"
    logger.log_event(last, "info", ending)
    if recording.ending:
        logger.log_end(last, recording.ending, "")
    logger.flush()


def show(recording: Recording, viewer: str, other: Other | None = None) -> None:
    """Show a recording in Rerun until the viewer is closed or this is interrupted.

    Args:
        recording: what to show.
        viewer: "web" or "native".
        other: the future that is shown beside it.

    Raises:
        SumoError: the viewer cannot be opened, or the `view` extra is not installed.
    """
    need("view", "the viewer")
    from sumo_dist.view.outputs import LiveServer, Outputs
    from sumo_dist.view.viewers import SERVER_PORT, Viewer, free_port

    with (
        LiveServer(free_port(SERVER_PORT), REPLAY_MEMORY) as server,
        Viewer(viewer, server.url) as opened,
        Outputs(recording.state_digest[:12], url=server.url) as out,
        suppress(KeyboardInterrupt),
    ):
        _tell(opened)
        _log(recording, out, other)
        opened.wait()


def show_file(path: Path, viewer: str) -> None:
    """Show an .rrd in Rerun; as `show`."""
    need("view", "the viewer")
    from sumo_dist.view.viewers import Viewer

    with Viewer(viewer, path) as opened:
        _tell(opened)
        with suppress(KeyboardInterrupt):
            opened.wait()


def _tell(viewer: "Viewer") -> None:
    if viewer.address:
        sys.stderr.write(f"watch the run at {viewer.address} (Ctrl-C ends)\n")


def render(recording: Recording, path: Path, other: Other | None = None) -> None:
    """Write a film of a recording, drawn by MuJoCo without a display.

    MuJoCo takes its graphics library from the environment when it is imported, so the drawing is
    done in a process of its own, which gets one that works here.

    Args:
        recording: what to draw.
        path: .mp4, .gif, .webp, or .jpg for a strip of a few pictures from start to end.
        other: the future that is drawn beside it, translucent; the film begins where they part.

    Raises:
        UsageError: another ending.
        SumoError: no graphics library works here, the film cannot be written, or the `film` extra
            is not installed.
    """
    need("film", "a film or picture")
    if path.suffix not in FILMS:
        raise unknown("film format", path.suffix, FILMS)
    World.of(recording)  # what is wrong with it is said here, in one line
    tried = []
    with TemporaryDirectory(prefix="sumo-dist-") as folder:
        source = Path(folder) / "run.npz"
        recording.save(source)
        words = [str(source), str(path)]
        if other is not None:
            other[0].save(source.with_name("other.npz"))
            words += [str(source.with_name("other.npz")), str(other[1])]
        for library in _graphics_libraries():
            done = subprocess.run(
                [sys.executable, "-P", "-m", "sumo_dist.view.film", *words],
                env={**os.environ, "MUJOCO_GL": library},
                stderr=subprocess.PIPE,
                text=True,
                check=False,
            )
            if done.returncode == 0:
                return
            reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
            if done.returncode != NO_GRAPHICS:
                raise SumoError(f"cannot render {path}: {reason}")
            tried.append(f"{library or 'default'} ({reason})")
    raise SumoError(
        f"no graphics library to draw with; tried MUJOCO_GL={', '.join(tried)}; "
        "on Debian: apt-get install libegl1 libgl1-mesa-dri, or libosmesa6"
    )


def _graphics_libraries() -> list[str]:
    """MUJOCO_GL's values to try; what the user has set is not overruled."""
    if chosen := os.environ.get("MUJOCO_GL"):
        return [chosen]
    if not sys.platform.startswith("linux"):
        return [""]
    return ["egl", "osmesa"]
