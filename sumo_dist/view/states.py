"""What robot, plans and workers were doing when: lanes of coloured bars over time."""

from collections.abc import Mapping

import numpy as np
import rerun as rr

from sumo_dist.episode.ending import End
from sumo_dist.planner.report import PlanReport
from sumo_dist.timing import TICK
from sumo_dist.view.marks import Color
from sumo_dist.view.outputs import Outputs

WORKER_LANES = 24  # of the workers that came first; others get one when they do not answer
MOST_LANES = 48
JUDGED_TICKS = 25  # of robot time over which a lane tells the worst of the plans

WALKS, STANDS = "walking", "standing: plan ran out"

_GOOD: Color = (38, 130, 96)
_WARN: Color = (190, 120, 30)
_BAD: Color = (190, 56, 56)
_IDLE: Color = (84, 92, 106)

ROBOT: Mapping[str, Color] = {
    WALKS: _GOOD,
    STANDS: _WARN,
    "paused": _IDLE,
    "stopping": _WARN,
    "stopped, sitting": _BAD,
    "rising": _WARN,
    "waiting": _IDLE,
    **dict.fromkeys(End, _IDLE),
    End.SUCCESS: (64, 150, 210),
    **dict.fromkeys((End.FELL, End.FAILURE, End.FAULT), _BAD),
}
PLANS: Mapping[str, Color] = {
    "on time": _GOOD,
    "late": _WARN,
    "rollouts lost": _WARN,
    "failed": _BAD,
}
WORKER: Mapping[str, Color] = {"answers": _GOOD, "silent": _BAD, "refuses": _BAD, "gone": _IDLE}

_MODES = {"running": WALKS, "stopped": "stopped, sitting"}
_SILENT = ("has not answered yet", "passed over")


class StateLog:
    """Logs lanes; each says only what is new."""

    def __init__(self, out: Outputs) -> None:
        """Start with no lane."""
        self._out = out
        self._last: dict[str, str] = {}
        self._mode = WALKS
        self._due = float("inf")  # tick at which the newest plan runs out
        self._worst, self._since = "on time", 0
        self._ended = False

    def reached(self, tick: int) -> None:
        """Take note of a tick of the robot."""
        stands = self._mode == WALKS and tick > self._due
        if not self._ended:
            self._set("robot", tick, STANDS if stands else self._mode, ROBOT)

    def plan(self, report: PlanReport, budget_ms: float) -> None:
        """Take note of a plan; the worst of some time is shown for as long."""
        plan, tick = report.plan, report.plan.tick
        self._due = tick + plan.horizon / TICK
        judged = {
            "failed": report.failed,
            "rollouts lost": report.lost > 0,
            "late": report.plan_ms > budget_ms,
        }
        verdict = next((name for name, holds in judged.items() if holds), "on time")
        order = list(PLANS)
        if order.index(verdict) >= order.index(self._worst) or tick >= self._since + JUDGED_TICKS:
            self._worst, self._since = verdict, tick
        self._set("plans", tick, self._worst, PLANS)

    def mode(self, mode: str) -> None:
        """Take note of what the robot says it does."""
        self._mode = _MODES.get(mode, mode)

    def worker(self, tick: int, name: str, state: str) -> None:
        """Take note of how a worker is, see `WorkerStatus`."""
        word = "answers" if state == "answers" else "silent" if state in _SILENT else "refuses"
        if state == "is leaving":
            word = "gone"
        lane = f"workers/{name}"
        lanes = sum(other.startswith("workers/") for other in self._last)
        room = WORKER_LANES if word == "answers" else MOST_LANES
        if lane in self._last or lanes < room:
            self._set(lane, tick, word, WORKER)

    def gone(self, tick: int, name: str) -> None:
        """Take note that a worker has left."""
        if f"workers/{name}" in self._last:
            self._set(f"workers/{name}", tick, "gone", WORKER)

    def end(self, tick: int, reason: str) -> None:
        """Take note of how the run ended, see `Ending.reason`."""
        self._ended = True
        kind = next((kind for kind in End if reason.startswith(kind)), End.FAILURE)
        self._set("robot", tick, kind.value, ROBOT)

    def _set(self, lane: str, tick: int, state: str, colors: Mapping[str, Color]) -> None:
        if self._last.get(lane) == state:
            return
        path = lane.split("/")
        if lane not in self._last:
            rgba = [
                (red << 24) + (green << 16) + (blue << 8) + 255
                for red, green, blue in colors.values()
            ]
            look = rr.StateConfiguration(values=list(colors), colors=np.array(rgba, np.uint32))
            self._out.log(path, look)
        self._last[lane] = state
        self._out.log(path, rr.StateChange(state=state), tick=tick)
