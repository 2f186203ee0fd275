"""A recording for people: as a Rerun file, in a viewer, as a film."""

import os
import subprocess
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError, unknown
from sumo_dist.extras import need
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.record.world import World

if TYPE_CHECKING:
    from sumo_dist.view.outputs import Outputs
    from sumo_dist.view.run_logger import RunLogger
    from sumo_dist.view.viewers import Viewer

FILMS = (".gif", ".jpg", ".mp4", ".webp")
STRIP = 6  # pictures in a strip
NO_GRAPHICS = 10  # exit code of the drawing process when there is nothing to draw with
REPLAY_MEMORY = "1GB"  # of a recording that is shown while it is read
CANDIDATES_LIMIT = 60_000_000  # [bytes]


def episode(recording: Recording) -> EpisodeConfig:
    """Return what decided a recorded episode."""
    return EpisodeConfig.of(recording.config.get("episode"))


def to_rrd(recording: Recording, path: Path, candidates_limit: int = CANDIDATES_LIMIT) -> None:
    """Write a recording as a Rerun file of bounded size.

    Args:
        recording: of any length.
        path: of the .rrd.
        candidates_limit: in a longer run, the candidates of only every so many plans are drawn
            [bytes].

    Raises:
        SumoError: the file cannot be written, or the `view` extra is not installed.
    """
    need("view", "Rerun's file of a run")
    from sumo_dist.view.outputs import Outputs
    from sumo_dist.view.rrd_file import RrdFile

    troubles = list[str]()
    size = sum(traces.nbytes for traces in recording.traces)
    with Outputs(path.parent.name, RrdFile(path, troubles.append)) as out:
        _log(recording, out, stride=max(1, -(-size // candidates_limit)))
    if troubles:
        raise SumoError(troubles[0])


def _log(recording: Recording, out: "Outputs", stride: int = 1) -> None:
    """Log a recording in the order of time, the candidates of every `stride`-th plan."""
    from sumo_dist.view.run_logger import RunLogger

    config = episode(recording)
    world = World.of(recording)
    with closing(
        RunLogger(out, world.task, config, distributed=False, model=world.model)
    ) as logger:
        _log_run(recording, logger, stride)


def _log_run(recording: Recording, logger: "RunLogger", stride: int) -> None:
    plans = deque(enumerate(reports(recording)))
    for tick, state in enumerate(recording.states):
        logger.log_state(tick, state)
        while plans and plans[0][1].plan.tick <= tick:
            i, report = plans.popleft()
            logger.log_plan(report)
            if i % stride == 0 and recording.traces:
                logger.log_candidates(tick, recording.costs[i], recording.traces[i])
            logger.log_ghost(report, tick, recording.estimates[tick], recording.memories[tick])
    last = len(recording.states) - 1
    ending = f"the run has ended: {recording.ending}" if recording.ending else "it ends here"
    logger.log_event(last, "info", ending)
    if recording.ending:
        logger.log_end(last, recording.ending, "")
    logger.flush()


def reports(recording: Recording) -> Iterator[PlanReport]:
    """Yield the account of each recorded plan, as far as a recording has it."""
    planner = episode(recording).planner
    for i, number in enumerate(recording.plan_numbers):
        finite = np.isfinite(recording.costs[i])
        plan = Plan(
            int(number),
            int(recording.plan_ticks[i]),
            recording.knots[i],
            planner.horizon,
            planner.spline,
        )
        yield PlanReport(
            plan=plan,
            costs=np.where(finite, recording.costs[i], 0.0),
            finite=finite,
            terms=recording.terms[i],
            weights=recording.weights[i],
            parameters=recording.parameters[i],
            plan_ms=float(recording.plan_ms[i]),
            own_ms=0.0,
            age_ticks=int(recording.age_ticks[i]),
            lost=int(recording.lost[i]),
            reissued=int(recording.reissued[i]),
            failed=not finite.any(),
        )


def show(recording: Recording, viewer: str) -> None:
    """Show a recording in Rerun until the viewer is closed or this is interrupted.

    Args:
        recording: what to show.
        viewer: "web" or "native".

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
        _log(recording, out)
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


def render(recording: Recording, path: Path) -> None:
    """Write a film of a recording, drawn by MuJoCo without a display.

    MuJoCo takes its graphics library from the environment when it is imported, so the drawing is
    done in a process of its own, which gets one that works here.

    Args:
        recording: what to draw.
        path: .mp4, .gif, .webp, or .jpg for a strip of a few pictures from start to end.

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
        for library in _graphics_libraries():
            done = subprocess.run(
                [sys.executable, "-P", "-m", "sumo_dist.view.film", source, path],
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
