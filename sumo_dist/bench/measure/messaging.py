"""`sumo-dist bench messaging`: what Zenoh and the services add to a plan on one host."""

import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_dist.authority.certificates import ROLES, ROUTER
from sumo_dist.authority.store import Authority
from sumo_dist.bench import layout
from sumo_dist.bench.layout import Result
from sumo_dist.bench.measure.planning import MakePlan, in_process, request
from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.dispatch.robot_link import RobotLink
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError
from sumo_dist.launch import serve
from sumo_dist.launch.deployment import Deployment, services
from sumo_dist.launch.launcher import Launcher, Service, dialled, listening
from sumo_dist.planner.planner import PlanRequest
from sumo_dist.provenance import cores
from sumo_dist.terminal import say
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import WORKER
from sumo_dist.wire.messages import EpisodeInfo

ANSWER_S = 60.0
WARM_UP = 5
Rows = dict[str, tuple[str, str]]
ROWS: Rows = {  # of the table: what, and its target [ms]
    "plan in one process": ("in_process_plan_ms", "-"),
    "plan over Zenoh": ("services_plan_ms", "-"),
    "added by messaging": ("added_ms", "p50 <= 5"),
    "optimizer's own time": ("services_own_ms", "<= 3"),
    "the same in one process": ("in_process_own_ms", "-"),
}
TLS_ROWS: Rows = {
    "plan over Zenoh": ("open_plan_ms", "-"),
    "plan over Zenoh with keys": ("keys_plan_ms", "-"),
    "added by TLS and the access list": ("added_ms", "p50 <= 1"),
}


@dataclass(frozen=True)
class Options:
    """Options of `bench messaging`.

    Attributes:
        json: print one JSON object.
        plans: made each way.
        workers: worker processes of one thread, and threads of the in-process planner; by default
            one for each core.
        engine: auto, native, native-portable or fallback; auto does not take the fallback.
        tls: compare services with keys of a throw-away authority with services without, in place
            of services with one process.
    """

    json: bool = False
    plans: int = 100
    workers: int | None = None
    engine: str = "auto"
    tls: bool = False

    def __post_init__(self) -> None:
        layout.check_at_least(1, plans=self.plans, workers=self.workers)


class Sample(NamedTuple):
    """One plan as the robot sees it."""

    plan_ms: float  # from the question to the answer
    own_ms: float  # the planner's own part: all but the rollouts and waiting for them


def main(options: Options) -> int:
    """Time both ways in turn, and print a table or one JSON object."""
    layout.run_bench("bench messaging", options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Make plans in this process and over Zenoh, or over Zenoh without and with keys."""
    engine, _ = layout.checked_engine(options.engine)
    workers, snapshot = options.workers or cores(), Snapshot.load()
    episode = Episode.assemble(EpisodeConfig(snapshot.task, engine=options.engine))
    with ExitStack() as stack:
        remote = stack.enter_context(over_zenoh(episode, workers))
        if options.tls:
            keys = stack.enter_context(_throw_away_keys())
            ways = remote, stack.enter_context(over_zenoh(episode, workers, keys))
        else:
            ways = stack.enter_context(in_process(episode, workers)), remote
        questions = (request(episode, snapshot, number) for number in count(1))
        here, there = interleave(questions, *ways, options.plans)
    about = {"engine": engine, "workers": workers, "plans": options.plans, "tls": options.tls}
    names = ("open", "keys") if options.tls else ("in_process", "services")
    return {**about, **figures(here, there, names)}


@contextmanager
def _throw_away_keys() -> Iterator[Path]:
    """Yield a host's folder with keys of every role."""
    with tempfile.TemporaryDirectory() as home:
        Authority.found(Path(home)).host("bench", ROLES, (), days=1.0)
        yield Path(home, "hosts", "bench")


@contextmanager
def over_zenoh(episode: Episode, workers: int, keys: Path | None = None) -> Iterator[MakePlan]:
    """Start the services of a run and yield what asks them for plans, in the robot's place.

    Args:
        episode: to plan for.
        workers: how many.
        keys: a host's folder, with which they speak TLS.
    """
    endpoint = listening(f"{'tcp' if keys is None else 'tls'}/127.0.0.1:0")
    planned = Deployment(episode.config, workers, 1, Path(), None, None, ANSWER_S, keys=keys)
    with Launcher() as launcher:
        routing = serve.Router(endpoint, keys=keys and keys / ROUTER)
        launcher.start(Service("router", "router", routing))
        *others, robot = services(planned, dialled(endpoint))
        for service in others:
            launcher.start(service)
        with robot.options.dial() as bus:
            link = RobotLink(bus, ANSWER_S, threading.Event(), lambda _, s: say(s), lambda _: None)
            info = EpisodeInfo("bench", episode.config.to_json(), episode.problem.hash, 1)
            link.enter(episode, info)
            _await_workers(bus, workers)
            yield lambda request: link.ask_plan(request, episode.controls.planner)


def interleave(
    questions: Iterator[PlanRequest], local: MakePlan, remote: MakePlan, plans: int
) -> tuple[list[Sample], list[Sample]]:
    """Make each plan both ways, taking turns in going first; they must be the same plans."""
    here, there = [], []
    for number in range(1, WARM_UP + plans + 1):
        ways = [(local, here), (remote, there)]
        knots, question = [], next(questions)
        for make_plan, samples in ways if number % 2 else reversed(ways):
            began = time.perf_counter()
            report = make_plan(question)
            samples.append(Sample((time.perf_counter() - began) * 1e3, report.own_ms))
            knots.append(report.plan.knots)
        if not np.array_equal(*knots):
            raise SumoError(f"plan {number} differs between this process and the services")
        if number % 50 == 0:
            say(f"{number} of {plans + WARM_UP} plans")
    return here[WARM_UP:], there[WARM_UP:]


def figures(
    here: Sequence[Sample], there: Sequence[Sample], names: tuple[str, str]
) -> dict[str, float]:
    """Percentiles of both ways, which have names, and what the second adds [ms]."""
    first, second = names
    found = {}
    for percent in (50, 99):
        local, remote = (np.percentile(samples, percent, axis=0) for samples in (here, there))
        added = remote[0] - local[0]
        named = {f"{first}_plan_ms": local[0], f"{first}_own_ms": local[1]}
        named |= {f"{second}_plan_ms": remote[0], f"{second}_own_ms": remote[1], "added_ms": added}
        found |= {f"{name}_p{percent}": round(float(value), 3) for name, value in named.items()}
    return found


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    services = f"router, state estimator, optimizer and {result['workers']} workers of one thread"
    if result["tls"]:
        ways = f"by {services}, without keys and with them"
    else:
        ways = f"by {result['workers']} threads of one process, and by {services}"
    yield (
        f"{result['plans']} plans made both ways in turn, bit for bit the same: {ways}; "
        f"{result['engine']}. Wall time as the robot sees it, in ms."
    )
    rows = [
        (what, f"{result[f'{name}_p50']:.2f}", f"{result[f'{name}_p99']:.2f}", target)
        for what, (name, target) in (TLS_ROWS if result["tls"] else ROWS).items()
    ]
    yield layout.markdown(("", "p50", "p99", "target"), rows)


def _await_workers(bus: Bus, workers: int) -> None:
    members = bus.watch(WORKER)
    deadline = time.monotonic() + ANSWER_S
    while len(members.now) < workers:
        if time.monotonic() > deadline:
            raise SumoError(f"{len(members.now)} of {workers} workers came up in {ANSWER_S:g} s")
        time.sleep(0.05)
