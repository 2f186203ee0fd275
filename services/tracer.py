"""Shows a run in Rerun, live and as DIR/run.rrd. The only service that talks to Rerun.

It only listens: nothing waits for it, and whatever fails in here is told once and harms nobody.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError
from sumo_dist.extras import need
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.folders import by_hand, episode_folder
from sumo_dist.services.backlog import Backlog, Presence
from sumo_dist.services.candidates import Candidates
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import SHOUT, Bus
from sumo_dist.wire.connection import Connection
from sumo_dist.wire.keys import ANY, INSECURE, ROUTER, WORKER, Member, unique_name, view_token
from sumo_dist.wire.messages import (
    EpisodeEnd,
    EpisodeInfo,
    Message,
    PlanMessage,
    Question,
    State,
    Traces,
)
from sumo_dist.wire.notices import Ack, Event, Health, WorkerHealth

if TYPE_CHECKING:  # Rerun is imported when the service runs: other roles do not have it
    from sumo_dist.view.run_logger import Level, RunLogger
    from sumo_dist.view.viewers import Viewer

QUESTIONS = 50  # of which state and memory are kept until the plan is there
SOON_TICKS = 5  # after a plan's begin; its future is shown from a state until then

SHOWN = (
    EpisodeInfo,
    State,
    Question,
    PlanMessage,
    Traces,
    Event,
    Ack,
    Health,
    WorkerHealth,
    EpisodeEnd,
)

EMBEDDED = "embedded"
_IDLE_S = 0.2
_LAST_WORDS_S = 1.0  # how long messages are still taken after the stop

_log = logging.getLogger("sumo_dist.tracer")


@dataclass(frozen=True, kw_only=True)
class TracerOptions(Connection):
    """A tracer.

    Attributes:
        out: folder for run.rrd, by default the robot's below runs/; one that is there already is
            left alone, and the next number taken. Later episodes of a session have theirs in
            episode-2 and so on below it.
        connect: the router's endpoint.
        keys: folder from `sumo-dist keys host`, for an endpoint with TLS.
        robot: whose episodes to show.
        viewer: "web", "native" or "none"; "embedded" is "web" for the control page, which shows it.
        layout: the tab of the view that is open at first: drive, tune or fleet.
        linger: stay after the last episode of a session, for the next robot's as well, until told
            to stop or the viewer is closed.
    """

    role: ClassVar[str] = "tracer"

    out: Path | None = None
    viewer: str = "web"
    layout: Literal["drive", "tune", "fleet"] = "drive"
    linger: bool = False


class Tracer:
    """Turns messages into what is seen; each episode gets a logger of its own."""

    def __init__(
        self,
        open_logger: Callable[[EpisodeInfo], "RunLogger"],
        out: Path | None = TracerOptions.out,
    ) -> None:
        """Start with no episode.

        Args:
            open_logger: returns where an episode is written, and ends the last.
            out: folder of the run.
        """
        self.ended = False
        self.dropped = 0  # messages that are not shown, as there were too many
        self._open_logger, self._out = open_logger, out
        self._logger: RunLogger | None = None
        self._run = ""
        self._workers: set[Member] = set()
        self._failures = 0
        self._begin(1)

    def _begin(self, iterations: int) -> None:
        """Expect an episode of whose plans the last of some iterations is shown at first."""
        self._iterations = iterations
        self._candidates = Candidates()
        self._questions = deque[Question](maxlen=QUESTIONS)
        self._awaiting: PlanReport | None = None  # whose state is still to come
        self._settings: dict[str, int | float | str] | None = None
        self._tick = -1
        self._over = False
        self._plan = -1
        self._speed = 1.0  # robot time per wall time for which plans are asked

    def show(self, item: Message | Presence) -> None:
        """Show one message; one that cannot be shown is left out and the first of them told."""
        try:
            self._show(item)
        except Exception as error:
            self._failures += 1
            if self._failures == 1:
                _log.warning(
                    "cannot show a %s (further ones are left out silently): %s",
                    type(item).__name__,
                    error,
                )

    def flush(self) -> None:
        """Bring viewer and file up to date."""
        try:
            if self._logger is not None:
                self._logger.flush()
        except RuntimeError as error:
            _log.warning("the viewer cannot be brought up to date: %s", error)

    def _show(self, item: Message | Presence) -> None:
        if isinstance(item, EpisodeInfo):
            self._enter(item)
        elif isinstance(item, Presence):
            self._presence(item)
        elif self._logger is not None and (type(item).any_run or item.run == self._run):
            self._show_message(self._logger, item)

    def _enter(self, info: EpisodeInfo) -> None:
        if info.run == self._run:
            return
        self.flush()
        self._run, self._logger, self.ended = info.run, None, False
        self._folder = _folder(self._out, info)
        self._begin(EpisodeConfig.from_json(info.config).planner.iterations)
        self._logger = self._open_logger(info)
        self._logger.log_workers(0, len(self._workers))

    def _show_message(self, logger: "RunLogger", item: Message) -> None:
        match item:
            case State() if item.tick > self._tick:
                self._tick = item.tick
                logger.log_state(item.tick, item.state, time.monotonic())
            case Question():
                self._questions.append(item)
                self._follow_settings(logger, item)
                realtime = item.clock == "realtime" and item.speed > 0
                self._speed = item.speed if realtime else 1.0
                self._show_future(logger)
            case PlanMessage() if item.plan.number != self._plan:  # in lockstep, some come twice
                self._plan = item.plan.number
                logger.log_plan(item.report, self._speed)
                self._candidates.add_plan(item.report)
                self._show_candidates(logger)
                self._awaiting = item.report
                self._show_future(logger)
            case Traces() if item.iteration == self._iterations - 1:
                self._candidates.add_shard(item)
                self._show_candidates(logger)
            case _:
                self._show_words(logger, item)

    def _show_words(self, logger: "RunLogger", item: Message) -> None:
        match item:
            case Health():
                for name, value in item.counters.items():
                    logger.log_health(max(self._tick, 0), item.source, name, value)
                if item.source == "robot":
                    logger.log_mode(max(self._tick, 0), item.mode)
            case WorkerHealth():
                for told in item.told:
                    logger.log_worker(max(self._tick, 0), *told[:3])
                logger.log_fleet(max(self._tick, 0), self.dropped)
            case Event():
                self._event(item.level, f"{item.source}: {item.text}")
            case Ack():
                how = f"refused: {item.refusal}" if item.refusal else "carried out"
                self._event("info", f"command {item.number} of {item.sender} {how}")
            case EpisodeEnd() if not self._over:  # it is sent more than once
                self._over = True
                level = "info" if item.success else "warning"
                self._event(level, f"the run has ended: {item.reason}")
                again = f"sumo-dist replay {self._folder}"
                logger.log_end(max(self._tick, 0), item.reason, again)
                self.ended = item.last

    def _show_candidates(self, logger: "RunLogger") -> None:
        for report, costs, paths in self._candidates.ready():
            logger.log_candidates(report.plan.tick, costs, paths)

    def _show_future(self, logger: "RunLogger") -> None:
        """Show where the newest plan leads, once the state is heard that it begins at, or nearly.

        A plan that was made for a time to come is there before its state.
        """
        report = self._awaiting
        if report is None:
            return
        for question in self._questions:
            if 0 <= question.tick - report.plan.tick < SOON_TICKS:
                logger.log_ghost(report, question.tick, question.state, question.memory)
                self._awaiting = None
                return

    def _follow_settings(self, logger: "RunLogger", question: Question) -> None:
        if question.settings != self._settings:
            self._settings = question.settings
            planner = PlannerConfig.from_settings(question.settings)
            self._iterations = planner.iterations
            logger.follow_settings(planner)

    def _presence(self, item: Presence) -> None:
        if item.alive:
            self._workers.add(item.member)
        else:
            self._workers.discard(item.member)
            if self._logger is not None:
                self._logger.log_worker_gone(max(self._tick, 0), item.member.id)
        if self._logger is not None:
            self._logger.log_workers(max(self._tick, 0), len(self._workers))

    def _event(self, level: "Level", text: str) -> None:
        if self._logger is not None:
            self._logger.log_event(max(self._tick, 0), level, text)


def run(options: TracerOptions, stop: threading.Event) -> None:
    """Show a run until it ends or this is told to stop.

    Raises:
        SumoError: there is no router, or the `view` extra is not installed.
    """
    need("view", "the tracer")
    backlog = Backlog()
    with options.dial() as bus:
        # Listen first: by the time that Rerun is loaded, the run may have begun.
        for kind in SHOWN:
            bus.subscribe(kind, backlog.put, address=bus.robot if kind is Traces else ANY)
        bus.watch(WORKER, lambda member, alive: backlog.put(Presence(member, alive)))
        _trace(options, bus, backlog, stop)


def _trace(options: TracerOptions, bus: Bus, backlog: Backlog, stop: threading.Event) -> None:
    from sumo_dist.view.outputs import LiveServer, Outputs
    from sumo_dist.view.rrd_file import RrdFile
    from sumo_dist.view.run_logger import RunLogger
    from sumo_dist.view.viewers import SERVER_PORT, free_port

    routers = bus.watch(ROUTER)
    with ExitStack() as stack, ExitStack() as episode:
        url, port = None, free_port(SERVER_PORT)
        if options.viewer != "none":
            url = stack.enter_context(LiveServer(port)).url
        viewer = stack.enter_context(_open_viewer(options.viewer, url))
        token = "-" if viewer.port is None else view_token(viewer.port, port)
        bus.announce("tracer", unique_name(), token)

        def open_logger(info: EpisodeInfo) -> RunLogger:
            episode.close()
            config = EpisodeConfig.from_json(info.config)
            folder = _folder(options.out, info)
            folder.mkdir(parents=True, exist_ok=True)
            file = RrdFile(_unused(folder), _log.warning)
            out = episode.enter_context(Outputs(info.run, file, url))
            logger = RunLogger(out, load_task(config.task), config, True, first=options.layout)
            episode.callback(logger.close)
            if any(router.build == INSECURE for router in routers.now):
                logger.log_event(0, "warning", SHOUT)
            return logger

        _follow(Tracer(open_logger, options.out), backlog, viewer, stop, options.linger)
        if backlog.dropped:
            _log.warning("too slow for the run: %d messages are not shown", backlog.dropped)


def _folder(out: Path | None, info: EpisodeInfo) -> Path:
    """Where the files of a session's episode are."""
    return episode_folder(out or by_hand(info.run), info.number)


def _unused(folder: Path) -> Path:
    """Path of DIR/run.rrd, or of DIR/run-2.rrd and so on after a tracer that died in this run."""
    names = ("run.rrd", *(f"run-{number}.rrd" for number in range(2, 1000)))
    return next(
        (path for name in names if not (path := folder / name).is_file()), folder / names[0]
    )


def _follow(
    tracer: Tracer, backlog: Backlog, viewer: "Viewer", stop: threading.Event, linger: bool
) -> None:
    """Show messages until the run has ended and all is shown; who lingers waits for the next."""
    watched, stopped = viewer.opened, None
    while stopped is None or time.monotonic() < stopped + _LAST_WORDS_S:
        if stopped is None and stop.is_set():
            stopped = time.monotonic()
        if watched and not viewer.running():
            watched = False
            if not tracer.ended:
                _log.warning("the viewer has ended; the run goes on and is recorded")
        item = backlog.get(_IDLE_S)
        tracer.dropped = backlog.dropped
        if item is not None:
            tracer.show(item)
            continue
        tracer.flush()
        lingers = linger and (watched or not viewer.opened)
        if stop.is_set() or (tracer.ended and not lingers):
            return
    tracer.flush()


def _open_viewer(kind: str, url: str | None) -> "Viewer":
    """Open a viewer; without one the run is still recorded."""
    from sumo_dist.view.viewers import Viewer

    try:
        viewer = Viewer("web" if kind == EMBEDDED else kind, url or "")
    except SumoError as error:
        _log.warning("%s; the run goes on and is recorded", error)
        return Viewer("none", "")
    if viewer.address and kind != EMBEDDED:
        _log.info("watch the run at %s", viewer.address)
    return viewer
