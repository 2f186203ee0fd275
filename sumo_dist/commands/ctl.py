"""`sumo-dist ctl`, `stop` and `resume`: commands to a robot that works, from any terminal."""

import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, get_args

import tyro

from sumo_dist.dispatch import commander
from sumo_dist.dispatch.commander import Commander
from sumo_dist.episode.command import Verb
from sumo_dist.errors import SumoError, UsageError, unknown
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.finding import ROUTER_S, Look, Place, Search
from sumo_dist.wire.keys import checked_name
from sumo_dist.wire.session import nobody_listens

LOOK_S = 0.1  # between two looks for a robot
STARTING_S = 3.0  # a run that has a router has a robot by then, or ends

# verb -> what its words are; a word in brackets may be left out
WORDS: dict[str, tuple[str, ...]] = {
    "pause": (),
    "resume": (),
    "step": ("[TICKS]",),
    "reset": ("[SEED]",),
    "task": ("TASK", "[SEED]"),
    "weight": ("NAME=VALUE",),
    "parameter": ("NAME=VALUE[,VALUE...]",),
    "planner": ("NAME=VALUE",),
    "stop": ("[REASON...]",),
    "stand": (),
}
DRAIN = "drain"  # is said to a worker, all others to the robot


@dataclass(frozen=True)
class StopOptions:
    """Options of `stop`.

    Attributes:
        connect: a router's endpoint; by default all of this user's on this machine.
        keys: folder from `sumo-dist keys host`, for a router with TLS.
        robot: its name on the bus; by default every robot that is found: who calls for a stop may
            not know names, and one robot too many that sits down costs less than one too few.
        reason: for the people who ask later.
    """

    connect: str | None = None
    keys: Path | None = None
    robot: str | None = None
    reason: str = ""


@dataclass(frozen=True)
class Options:
    """Options of `resume`.

    Attributes:
        connect: the router's endpoint; by default that of the run that is here.
        keys: folder from `sumo-dist keys host`, for a router with TLS.
        robot: its name on the bus; by default the one that is there.
    """

    connect: str | None = None
    keys: Path | None = None
    robot: str | None = None


@dataclass(frozen=True)
class CtlOptions:
    """Options of `ctl`.

    Attributes:
        words: what to do: pause, resume, step [TICKS], reset [SEED], task TASK [SEED], weight
            NAME=VALUE, parameter NAME=VALUE, planner NAME=VALUE, stop [REASON...], stand, or drain
            WORKER: it finishes what it was asked, and ends.
        connect: the router's endpoint; by default that of the run that is here.
        keys: folder from `sumo-dist keys host`, for a router with TLS.
        robot: its name on the bus; by default the one that is there.
    """

    words: Annotated[tuple[str, ...], tyro.conf.Positional]
    connect: str | None = None
    keys: Path | None = None
    robot: str | None = None


def stop(options: StopOptions) -> int:
    """Make robots sit down, whatever they do; 3 if one did not answer."""
    search = _search(options)
    look = _robots(search)
    failed = bool(look.silent)
    with ThreadPoolExecutor(max(1, len(look.places))) as pool:
        told = [
            pool.submit(_command, search, place, "stop", value=options.reason)
            for place in look.places
        ]
        for answer in as_completed(told):
            try:
                print(answer.result(), flush=True)
            except SumoError as error:
                failed = True
                print(f"sumo-dist: {error}", file=sys.stderr, flush=True)
    for router in look.silent:
        print(
            f"sumo-dist: the router at {router.endpoint} ({router.who}) "
            "does not answer: what runs there was not stopped",
            file=sys.stderr,
        )
    return SumoError.exit_code if failed else 0


def _robots(search: Search) -> Look:
    """Return all robots to stop, waiting for those that are starting.

    Raises:
        SumoError: there is none.
    """
    if search.known is not None:
        return Look([search.known], [], [])
    deadline = time.monotonic() + STARTING_S
    while not (look := search.look()).places:
        if time.monotonic() >= deadline or not (look.routers or look.silent):
            raise SumoError(search.nobody(look))
        time.sleep(LOOK_S)
    return look


def resume(options: Options) -> int:
    """Let a robot that has stopped get up and go on."""
    search = _search(options)
    print(_command(search, search.one(), "stand"))
    return 0


def main(options: CtlOptions) -> int:
    """Give a command and say what came of it."""
    if options.words[:1] == (DRAIN,):
        return _drain(options)
    if not options.words or options.words[0] not in WORDS:
        raise unknown("command", " ".join(options.words[:1]), [*get_args(Verb), DRAIN])
    verb, *words = options.words
    name, value = _parsed(verb, words)
    search = _search(options)
    print(_command(search, search.one(), verb, name, value))  # pyright: ignore[reportArgumentType]
    return 0


def _drain(options: CtlOptions) -> int:
    if len(options.words) != 2:
        raise UsageError(
            f"needs `ctl {DRAIN} WORKER`, got {' '.join(options.words[1:]) or 'nothing'}"
        )
    worker, search = checked_name("worker", options.words[1]), _search(options)
    place = search.one()
    if nobody_listens(place.endpoint):
        raise SumoError(f"{worker} cannot be told to end: no router answers at {place.endpoint}")
    with Bus.dial(place.endpoint, place.robot, timeout=ROUTER_S, keys=search.keys) as bus:
        if not Commander(bus).drain(worker):
            raise SumoError(f"{worker} is still at {place.endpoint}")
    print(f"{worker} is not at {place.endpoint} any more")
    return 0


def _search(options: StopOptions | Options | CtlOptions) -> Search:
    keys = keys_for(options.connect, options.keys, "operator")
    return Search(options.connect, options.robot, keys)


def _parsed(verb: str, words: list[str]) -> tuple[str, str]:
    """Name and value that a verb's words are."""
    wanted = WORDS[verb]
    if verb == "stop":
        return "", " ".join(words)
    least = sum(not word.startswith("[") for word in wanted)
    if not least <= len(words) <= len(wanted):
        raise UsageError(
            f"needs `ctl {' '.join([verb, *wanted])}`, got {' '.join(words) or 'nothing'}"
        )
    if verb in ("weight", "parameter", "planner"):
        name, equals, value = words[0].partition("=")
        if not equals:
            raise UsageError(f"needs `ctl {verb} {wanted[0]}`, got {words[0]!r}")
        return name, value
    if verb == "task":
        return words[0], words[1] if len(words) > 1 else ""
    return "", words[0] if words else ""


def _command(search: Search, place: Place, verb: Verb, name: str = "", value: str = "") -> str:
    """Send a command until the robot answers; return what came of it."""
    if nobody_listens(place.endpoint):
        raise SumoError(f"{place} cannot be told to {verb}: no router answers there")
    with Bus.dial(place.endpoint, place.robot, timeout=ROUTER_S, keys=search.keys) as bus:
        ack = Commander(bus).give(verb, name, value)
    if ack is None:
        raise SumoError(
            f"{place.who} did not answer within {commander.PATIENCE_S:g} s: "
            f"it is not at {place.endpoint}"
        )
    if ack.refusal:
        raise SumoError(f"{place.who} refuses to {verb}: {ack.refusal}")
    return f"{place.who}: {verb} at tick {ack.tick}"
