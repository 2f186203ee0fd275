"""Finding the robots that are there, by asking the routers of this machine, or a named one."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import zenoh

from sumo_dist.authority.certificates import KeysError
from sumo_dist.authority.folder import KeyFolder
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.wire.keys import ANY, alive_keys, checked_name, parse_presence
from sumo_dist.wire.routers import LocalRouter, local_routers
from sumo_dist.wire.session import (
    DEFAULT_ENDPOINT,
    checked_endpoint,
    nobody_listens,
    open_client,
)

ROUTER_S = 0.6  # a router that has not answered by then is left out [s]
_ROLES = ("robot", "optimizer")  # whose presence says that a robot's bus is in use


@dataclass(frozen=True, order=True)
class Place:
    """A robot's bus.

    Attributes:
        endpoint: of its router.
        robot: its name.
        what: its router is for, "" if nobody says so.
    """

    endpoint: str
    robot: str
    what: str = ""

    @property
    def who(self) -> str:
        """The robot, and what it does if that is known."""
        return f"{self.robot} ({self.what})" if self.what else self.robot

    def __str__(self) -> str:
        return f"{self.who} at {self.endpoint}"


@dataclass(frozen=True)
class Look:
    """What was there.

    Attributes:
        places: the robots.
        routers: endpoints of all routers that answered.
        silent: routers of this machine that did not: they are starting, or hang.
    """

    places: list[Place]
    routers: list[str]
    silent: list[LocalRouter]


@dataclass(frozen=True)
class Search:
    """Where and for whom to look.

    Attributes:
        connect: a router's endpoint; None looks at all routers of this machine.
        robot: its name; None looks for all.
        keys: to show where an endpoint asks for them.
    """

    connect: str | None = None
    robot: str | None = None
    keys: KeyFolder | None = None

    def __post_init__(self) -> None:
        if self.connect is not None:
            checked_endpoint(self.connect)
        if self.robot is not None:
            checked_name("robot", self.robot)

    @property
    def known(self) -> Place | None:
        """The place, if both are given: nobody has to be asked."""
        if self.connect is None or self.robot is None:
            return None
        return Place(self.connect, self.robot)

    def look(self) -> Look:
        """Look once."""
        notes = {} if self.connect is not None else {r.endpoint: r for r in local_routers()}
        endpoints = list(dict.fromkeys([self.connect or DEFAULT_ENDPOINT, *notes]))
        with ThreadPoolExecutor(len(endpoints)) as pool:
            found = dict(zip(endpoints, pool.map(self._robots_at, endpoints), strict=True))
        return Look(
            places=[
                Place(endpoint, robot, notes[endpoint].what if endpoint in notes else "")
                for endpoint, robots in found.items()
                for robot in robots or ()
                if self.robot in (None, robot)
            ],
            routers=[endpoint for endpoint, robots in found.items() if robots is not None],
            silent=[note for endpoint, note in notes.items() if found[endpoint] is None],
        )

    def _robots_at(self, endpoint: str) -> list[str] | None:
        """Names of the robots at a router; None if it does not answer in time.

        Raises:
            KeysError: the router that was named does not take the keys.
        """
        if nobody_listens(endpoint):
            return None
        try:
            session = open_client(endpoint, ROUTER_S, self.keys)
        except SumoError as error:
            if self.connect is not None and isinstance(error, KeysError | UsageError):
                raise
            return None
        try:
            return _robots(session)
        except zenoh.ZError:
            return None
        finally:
            session.close()

    def one(self) -> Place:
        """Return the place of the one robot that is there.

        Raises:
            SumoError: there is none.
            UsageError: there are several.
        """
        if self.known is not None:
            return self.known
        look = self.look()
        if not look.places:
            raise SumoError(self.nobody(look))
        return only(look.places)

    def nobody(self, look: Look) -> str:
        """Say that no robot was there, and what was."""
        whom = f"no robot named {self.robot}" if self.robot else "no robot"
        if look.routers or look.silent:
            at = ", ".join([*look.routers, *(f"{r.endpoint} ({r.who})" for r in look.silent)])
            return f"{whom} answers at {at}: it is starting, or has ended"
        if self.connect is not None:
            return f"{whom} is there: no router answers at {self.connect}"
        return (
            f"{whom} is here: this user has no run with workers on this machine, and no router "
            f"answers at {DEFAULT_ENDPOINT}; --connect names one elsewhere"
        )


def only(places: Sequence[Place]) -> Place:
    """Return the only place.

    Raises:
        UsageError: there are several; it names them with the options that choose one.
    """
    if len(places) == 1:
        return places[0]
    listed = "; ".join(f"{_choice(place, places)} for {place}" for place in places)
    raise UsageError(f"{len(places)} robots are here, choose one: {listed}")


def router_here() -> str | None:
    """Return the endpoint of the router on this machine; None if none answers.

    Raises:
        UsageError: there are several; it names them with the option that chooses one.
    """
    endpoints = Search().look().routers
    if len(endpoints) <= 1:
        return next(iter(endpoints), None)
    what = {router.endpoint: router.who for router in local_routers()}
    listed = "; ".join(f"--connect {e} for {what.get(e, 'a router')}" for e in endpoints)
    raise UsageError(f"{len(endpoints)} routers are here, choose one: {listed}")


def _choice(place: Place, places: Sequence[Place]) -> str:
    """Options that choose a place among others."""
    if [other.robot for other in places].count(place.robot) == 1:
        return f"--robot {place.robot}"
    if [other.endpoint for other in places].count(place.endpoint) == 1:
        return f"--connect {place.endpoint}"
    return f"--connect {place.endpoint} --robot {place.robot}"


def _robots(session: zenoh.Session) -> list[str]:
    """Names of the robots that a session sees."""
    found = set()
    for role in _ROLES:
        replies = session.liveliness().get(alive_keys(ANY, role), timeout=ROUTER_S)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        found |= {presence[0] for key in keys if (presence := parse_presence(key))}
    return sorted(found)
