"""`sumo-dist top`: who is alive on a robot's bus, what they do, and what they have lost."""

import json
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.finding import ROUTER_S, Search, router_here
from sumo_dist.wire.keys import POOL, WORKER, Member, checked_name
from sumo_dist.wire.notices import Health

DIAL_S = 5.0  # for a router that is named
SEEN_S = 1.0  # those that are there are seen within milliseconds
STALE_S = 2.0  # a service that said nothing for this long is shown as silent
FEW = 8  # as many workers, or members of a role, are shown by name; of more it is said how many
_CLEAR = "\x1b[H\x1b[J"  # to the top left, and all below is gone


@dataclass(frozen=True)
class Options:
    """Options of `top`.

    Attributes:
        connect: the router's endpoint; by default that of the run that is here.
        keys: folder from `sumo-dist keys host`, for a router with TLS.
        robot: its name on the bus; by default the one that is there.
        every: between two looks [s].
        times: how many looks; until Ctrl-C by default.
        json: one JSON object a look, for logs, instead of a screen.
        worker: instead of all that, only say whether a rollout worker of this name is there: exit
            code 0 if it is, 1 if not. For whoever starts workers and wants to know when one is
            ready; no robot has to be there.
    """

    connect: str | None = None
    keys: Path | None = None
    robot: str | None = None
    every: float = 1.0
    times: int | None = None
    json: bool = False
    worker: str | None = None

    def __post_init__(self) -> None:
        if self.worker is not None:
            checked_name("worker", self.worker)
        if not 0.1 <= self.every <= 3600:
            raise UsageError(f"every must be from 0.1 to 3600 s, got {self.every}")
        if self.times is not None and self.times < 1:
            raise UsageError(f"times must be at least 1, got {self.times}")


@dataclass(frozen=True)
class Row:
    """One service.

    Attributes:
        name: its source name on the bus.
        mode: one word for what it does; "silent" if it has not spoken lately.
        age: since it last spoke [s].
        counters: what it says of itself.
        worker: it is one of the rollout workers.
    """

    name: str
    mode: str
    age: float
    counters: dict[str, Any]
    worker: bool = False


class Board:
    """What all services said last."""

    def __init__(self) -> None:
        """Start with nobody."""
        self._said: dict[str, tuple[float, Health]] = {}

    def take(self, health: Health) -> None:
        """Take note of a service."""
        self._said[health.source] = time.monotonic(), health

    def rows(self) -> list[Row]:
        """One row a service, by name."""
        now = time.monotonic()
        return [
            Row(
                name,
                health.mode if now - at < STALE_S else "silent",
                round(now - at, 1),
                dict(health.counters),
                worker=health.mode == WORKER,
            )
            for name, (at, health) in sorted(dict(self._said).items())
        ]


def main(options: Options) -> int:
    """Show the services until told to stop."""
    if options.worker is not None:
        return find_worker(options)
    keys = keys_for(options.connect, options.keys, "operator", "tracer")
    place = Search(options.connect, options.robot, keys).one()
    with Bus.dial(place.endpoint, place.robot, timeout=ROUTER_S, keys=keys) as bus:
        board, members = Board(), bus.watch()
        bus.subscribe(Health, board.take)
        looks = 0
        while options.times is None or looks < options.times:
            time.sleep(options.every)
            looks += 1
            rows, alive = board.rows(), members.now
            if options.json:
                print(json.dumps(look(rows, alive)), flush=True)
            else:
                clear = _CLEAR if sys.stdout.isatty() else ""
                print(clear + screen(place.who, rows, alive), flush=True)
    return 0


def find_worker(options: Options) -> int:
    """Return 0 if the worker is seen at a router, by default at that of this machine, else 1.

    Raises:
        SumoError: there is no router.
    """
    name, endpoint = options.worker, options.connect or router_here()
    if endpoint is None:
        raise SumoError("no router on this machine: --connect names one elsewhere")
    keys = keys_for(endpoint, options.keys, WORKER, "operator", "tracer")
    with Bus.dial(endpoint, POOL, timeout=DIAL_S, keys=keys) as bus:
        members = bus.watch(WORKER)
        deadline = time.monotonic() + SEEN_S
        while not any(member.id == name for member in members.now):
            if time.monotonic() > deadline:
                print(f"worker {name} is not at {endpoint}")
                return 1
            time.sleep(0.02)
    print(f"worker {name} is at {endpoint}")
    return 0


def look(rows: Iterable[Row], alive: Iterable[Member]) -> dict[str, Any]:
    """Return one look as data."""
    return {
        "alive": sorted(f"{member.role} {member.id}" for member in alive),
        "services": {row.name: {"mode": row.mode, "age": row.age, **row.counters} for row in rows},
    }


def screen(who: str, rows: list[Row], alive: Iterable[Member]) -> str:
    """Lay one look out: a line a service, then its counters that are not zero.

    Many workers share one line, but for those that are silent.
    """
    workers = [row for row in rows if row.worker]
    if len(workers) > FEW:
        rows = [row for row in rows if not row.worker] + _summed(workers)
    lines = [f"{who}: {_there(alive)}", ""]
    width = max((len(row.name) for row in rows), default=0)
    for row in rows:
        told = ", ".join(f"{name} {value}" for name, value in row.counters.items() if value != 0)
        lines.append(f"{row.name:<{width}}  {row.mode:<10}  {row.age:4.1f} s ago  {told}")
    return "\n".join(lines)


def _there(alive: Iterable[Member]) -> str:
    """Say who is there, by name where a role has few."""
    roles: dict[str, list[str]] = {}
    for member in alive:
        roles.setdefault(member.role, []).append(member.id)
    named = (
        [f"{role} {name}" for name in sorted(ids)] if len(ids) <= FEW else [f"{len(ids)} {role}s"]
        for role, ids in sorted(roles.items())
    )
    return ", ".join(text for texts in named for text in texts) or "nobody"


def _summed(workers: list[Row]) -> list[Row]:
    """Return one row for all workers that speak, and one for each of a few that do not."""
    silent = [row for row in workers if row.mode == "silent"]
    speaking = [row for row in workers if row.mode != "silent"]
    shown = sorted(silent, key=lambda row: row.age)[:FEW]
    if more := silent[len(shown) :]:
        shown.append(Row(f"{len(more)} more", "silent", min(row.age for row in more), {}))
    if not speaking:
        return shown
    oldest = max(row.age for row in speaking)
    names = dict.fromkeys(name for row in speaking for name in row.counters)
    counters = {name: _together([row.counters.get(name, 0) for row in speaking]) for name in names}
    return [Row(f"{len(speaking)} workers", WORKER, oldest, counters), *shown]


def _together(values: list[Any]) -> str | int:
    """Say what a counter is of all workers: sum and range, or the words that there are."""
    words = sorted({value for value in values if isinstance(value, str) and value})
    if words:
        return " and ".join([*words[:3], *([f"{len(words) - 3} more"] if len(words) > 3 else [])])
    numbers = [value for value in values if not isinstance(value, str)]
    if not any(numbers):
        return 0
    return f"{round(sum(numbers), 1)} ({min(numbers)} to {max(numbers)} each)"
