"""`sumo-dist bench links`: what a slow or lossy link costs, between which services.

Real services and two routers, with a bridge between these that disturbs what passes. The first row
has the bridge and nothing else.
"""

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sumo_dist.bench.layout import Result, check_at_least, checked_engine, run_bench, table
from sumo_dist.episode.summary import read_summary
from sumo_dist.faults.run import FaultRun
from sumo_dist.faults.script import Fault, Script
from sumo_dist.record.recording import Recording
from sumo_dist.terminal import say
from sumo_dist.timing import anchor_tick
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import PlanMessage, State

OPTIMIZER, WORKERS = ("optimizer",), ("local-0", "local-1")
ALWAYS_S = 60.0  # longer than a run
HORIZON_S = 0.6  # with 4 rollouts; 6 of 0.4 s cost as much, and may end in a joint that is too fast

COLUMNS = {
    "far away": "{far}",
    "link": "{link}",
    "plans": "{plans}",
    "periods between plans": "{periods:.1f}",
    "without rollouts": "{failed}",
    "rollouts": "{rollouts:g}",
    "lost": "{lost}",
    "age p50 [ms]": "{age_ms:.0f}",
    "late": "{late}",
    "end": "{end}",
}


class Link(NamedTuple):
    """A link and who is at its far end; all others are with the robot."""

    far: str
    behind: tuple[str, ...]
    text: str
    faults: tuple[Fault, ...] = ()


def delayed(ms: float) -> Fault:
    """A link over which every message takes some time, each way [ms]."""
    return Fault("delay", 0, lasts=ALWAYS_S, delay_ms=ms)


def lossy(share: float) -> Fault:
    """A link that loses some share of all messages."""
    return Fault("drop", 0, lasts=ALWAYS_S, share=share)


LINKS = (
    *(
        Link(far, behind, f"{ms} ms", (delayed(ms),) if ms else ())
        for far, behind in (("optimizer", OPTIMIZER), ("optimizer, workers", OPTIMIZER + WORKERS))
        for ms in (0, 10, 20, 40)
    ),
    *(Link("one worker", WORKERS[:1], f"{ms} ms", (delayed(ms),)) for ms in (20, 50)),
    *(Link("both workers", WORKERS, f"{ms} ms", (delayed(ms),)) for ms in (20, 50)),
    *(Link("both workers", WORKERS, f"{s:.0%} lost", (lossy(s),)) for s in (0.01, 0.1)),
    Link("optimizer", OPTIMIZER, "20 ms, 1 % lost", (delayed(20), lossy(0.01))),
    Link("one worker", WORKERS[:1], "1 Mbit/s", (Fault("narrow", 0, lasts=ALWAYS_S),)),
)


@dataclass(frozen=True)
class Options:
    """Options of `bench links`.

    Attributes:
        json: print one JSON object.
        runs: of each row, with seeds 1, 2 ...
        speed: robot time per wall time. A busy machine needs a lower one; links become slower
            with it, so that a row's delay is the same share of a plan's period.
        time_limit: robot time of a run [s].
        rollouts: per plan, at most.
    """

    json: bool = False
    runs: int = 1
    speed: float = 1.0
    time_limit: float = 4.0
    rollouts: int = 4

    def __post_init__(self) -> None:
        check_at_least(1, runs=self.runs, rollouts=self.rollouts)


def main(options: Options) -> int:
    """Run all rows and print a table or one JSON object."""
    run_bench("bench links", options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Run every link, each run with processes of its own."""
    engine, _ = checked_engine("auto")
    rows = []
    for link in LINKS:
        found = [played(link, options, seed) for seed in range(1, options.runs + 1)]
        rows.append({"far": link.far, "link": link.text, **together(found)})
        say(f"{link.far}, {link.text}: {rows[-1]}")
    about = {"runs": options.runs, "speed": options.speed, "time_limit": options.time_limit}
    return {"engine": engine, **about, "rollouts": options.rollouts, "rows": rows}


class Played(NamedTuple):
    """A run over a link."""

    recording: Recording
    end: str
    late: int  # plans that came after the tick that they are for


def played(link: Link, options: Options, seed: int) -> Played:
    """Run once over a link."""
    faults = tuple(
        replace(f, delay_ms=f.delay_ms / options.speed, kbit_s=f.kbit_s * options.speed)
        for f in link.faults
    )
    script = Script(
        faults,
        seed=seed,
        speed=options.speed,
        time_limit=options.time_limit,
        settings=(f"rollouts={options.rollouts}", f"horizon={HORIZON_S}"),
        behind=link.behind,
        give_way=False,
    )
    with tempfile.TemporaryDirectory() as name, FaultRun(script, Path(name)) as run:
        with Bus.dial(run.near, "spot") as bus:
            arrivals = Arrivals(bus)
            run.play()
        end = read_summary(Path(name))["end_reason"]
        return Played(Recording.load(Path(name) / "run.npz"), end, arrivals.late)


class Arrivals:
    """Plans as they come to the robot's router.

    Attributes:
        late: those of a tick that was over by then.
    """

    def __init__(self, bus: Bus) -> None:
        """Listen beside the robot."""
        self.late, self._tick, self._numbers = 0, -1, set[int]()
        bus.subscribe(State, self._on_state)
        bus.subscribe(PlanMessage, self._on_plan)

    def _on_state(self, state: State) -> None:
        self._tick = max(self._tick, state.tick)

    def _on_plan(self, message: PlanMessage) -> None:
        plan = message.plan
        if plan.tick == anchor_tick(plan.number) > 0 and plan.number not in self._numbers:
            self._numbers.add(plan.number)
            self.late += plan.tick < self._tick


def together(found: Sequence[Played]) -> dict[str, Any]:
    """Return the row of some runs over one link."""
    recordings = [run.recording for run in found]
    plans = [len(recording.plan_numbers) for recording in recordings]
    ages = np.concatenate([np.asarray(r.age_ticks, float) for r in recordings])
    lost, made = (
        np.concatenate([np.asarray(getattr(r, n)) for r in recordings])
        for n in ("lost", "rollouts")
    )
    gaps = np.concatenate([np.diff(np.asarray(r.plan_numbers)) for r in recordings])
    return {
        "plans": sum(plans),
        "periods": float(gaps.mean()) if len(gaps) else float("nan"),
        "failed": int(np.count_nonzero(lost >= made)),
        "rollouts": float(np.median(made)),
        "lost": int(lost.sum()),
        "age_ms": float(np.median(ages)) * 20.0,
        "late": sum(run.late for run in found),
        "end": ", ".join(sorted({run.end for run in found})),
    }


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    yield (
        f"spot/move_box at speed {result['speed']:g}, {result['time_limit']:g} s of robot time, "
        f"up to {result['rollouts']} rollouts of {HORIZON_S:g} s, two workers of one thread; "
        f"{result['engine']}."
    )
    yield table(COLUMNS, result["rows"])
