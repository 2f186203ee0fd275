"""What a script or a notebook shows of a loop of its own: live, and as a file."""

import shutil
import sys
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.scripting import MPC, Numbers, configured, state_of
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.extras import need
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.planner.report import PlanReport
from sumo_dist.tasks.task import Task

_HEIGHT = 600  # of the viewer in a notebook [pixels]


def show(
    task: Task | str | Path | MPC,
    *,
    viewer: str = "web",
    planner: Mapping[str, int | float | str] | None = None,
    param: Numbers | None = None,
) -> "Show":
    """Open a view of a task, to be told states and plans; use it in `with`, or `close()` it.

    Args:
        task: its name, the path of its file, the task itself, or an `MPC`, whose plans are then
            drawn without being told, each with its candidates.
        viewer: "web", a page at an address that is printed; "native", a window; or "none", what is
            told can be saved.
        planner: settings that the plans are made with, for a task.
        param: parameters of the task, such as where the goal is, for a task.

    Raises:
        SumoError: the `view` extra is not installed, or the viewer does not open.
        UsageError: an argument is none of those that are valid, which the message names.
    """
    need("view", "sumo_dist.show")
    if isinstance(task, MPC):
        if planner is not None or param is not None:
            raise UsageError("show: an MPC has settings and parameters of its own")
        config = EpisodeConfig.of(task.recording.config["episode"])
        return Show(task.task, config, viewer, task)
    return Show(*configured(task, 0, planner, None, param), viewer)


class Show:
    """A view that somebody's own loop tells what happens. Nothing in it slows or stops the loop.

    Attributes:
        address: of the page to open in a browser; None without one.
    """

    def __init__(
        self, task: Task, config: EpisodeConfig, viewer: str = "web", mpc: MPC | None = None
    ) -> None:
        """Open the viewer; see `show`."""
        from sumo_dist.view.outputs import LiveServer, Outputs
        from sumo_dist.view.rrd_file import RrdFile
        from sumo_dist.view.run_logger import RunLogger
        from sumo_dist.view.viewers import SERVER_PORT, Viewer, free_port

        self._model, self._mpc = compile_model(task.scene, PLANT), mpc
        self._tick, self._plan, self._troubles = -1, -1, list[str]()
        with ExitStack() as stack:
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="sumo-dist-")))
            self._file, url = folder / "show.rrd", None
            if viewer != "none":
                url = stack.enter_context(LiveServer(free_port(SERVER_PORT))).url
            self._viewer = stack.enter_context(Viewer(viewer, url or ""))
            file = RrdFile(self._file, self._troubles.append)
            out = stack.enter_context(Outputs(folder.name, file, url))
            self._logger = RunLogger(out, task, config, distributed=False, model=self._model)
            stack.callback(self._logger.close)
            self._open: ExitStack = stack.pop_all()
        self.address = self._viewer.address
        if self.address:
            sys.stderr.write(f"watch at {self.address}\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def state(self, state: np.ndarray, tick: int | None = None) -> None:
        """Show where everything is.

        Args:
            state: (nq + nv,), qpos then qvel, of the robot and the objects.
            tick: of 0.02 s of robot time; by default the next one, and of an `MPC` its own.

        Raises:
            UsageError: it is no state of the task, or a tick before one that has been shown.
        """
        state = state_of(self._model, state)
        if tick is None:
            tick = self._tick + 1 if self._mpc is None else self._mpc.tick
        if tick < self._tick:
            raise UsageError(f"tick {tick} comes after tick {self._tick}: time does not go back")
        self._tick = tick
        self._logger.log_state(tick, state)
        if self._mpc is not None and self._mpc.report is not None:
            self.plan(self._mpc.report)
            self._logger.log_ghost(self._mpc.report, tick, state, self._mpc.memory)

    def plan(self, report: PlanReport) -> None:
        """Show a plan's costs and timing, and of an `MPC`'s the candidates; none is shown twice."""
        if report.plan.number == self._plan:
            return
        self._plan = report.plan.number
        self._logger.log_plan(report)
        if self._mpc is not None and report is self._mpc.report:
            recording = self._mpc.recording
            self._logger.log_candidates(report.plan.tick, recording.costs[-1], recording.traces[-1])

    def say(self, text: str) -> None:
        """Show a line among the events."""
        self._logger.log_event(max(self._tick, 0), "info", text)

    def save(self, path: str | Path) -> None:
        """Write what has been shown so far as an .rrd, which `rerun` and the web viewer open.

        Raises:
            SumoError: it cannot be written.
            UsageError: the name has another ending.
        """
        if Path(path).suffix != ".rrd":
            raise UsageError(f"save writes Rerun's files, NAME.rrd, got {path}")
        self._logger.flush()
        if self._troubles:
            raise SumoError(self._troubles[0])
        try:
            shutil.copyfile(self._file, path)
        except OSError as error:
            raise SumoError(f"cannot write {path}: {error.strerror}") from None

    def wait(self) -> None:
        """Return when the viewer is closed, or at Ctrl-C; at once if there is none."""
        self._logger.flush()
        with suppress(KeyboardInterrupt):
            self._viewer.wait()

    def close(self) -> None:
        """Close the viewer."""
        self._open.close()

    def _repr_html_(self) -> str:
        """Put the page into a notebook whose browser runs on this machine."""
        if self.address is None:
            return "<p>a view without a page: <code>save</code> it, or give viewer='web'</p>"
        address: Any = escape(self.address)
        return f'<iframe src="{address}" width="100%" height="{_HEIGHT}"></iframe>'
