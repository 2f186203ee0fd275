"""The names of everything on the bus.

Messages travel on `sumo/v<SCHEMA>/<robot>/<topic>[/<address>]`; those to and from rollout workers,
which serve any robot, on `sumo/v<SCHEMA>/pool/<topic>/<address>`. The prefix of liveliness tokens,
`sumo/alive/<robot or pool>/<role>/<id>/<schema>/<build>`, has no version: services of different
versions or builds see each other and can say so.
"""

import os
import re
import socket
from dataclasses import dataclass
from urllib.parse import quote, unquote

from sumo_dist.errors import UsageError

SCHEMA = 7  # raise it with every change of a message's fields or of their meaning

NAME_PATTERN = r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}"  # free of Zenoh's / * $ ? #
ANY = "*"
POOL = "pool"  # stands where else a robot's name does, so no robot can have it
PRIORITIES = 9  # a robot's priority at workers is from -9 to 9
WORKER = "worker"  # the role that is of the pool, as the router's is; all others are of a robot
ROUTER = "router"
OPERATOR = "operator"
OPEN, SECURE, INSECURE = "open", "secure", "insecure"  # a router's in place of a build


@dataclass(frozen=True, order=True)
class Member:
    """A living service.

    Attributes:
        role: "optimizer", "rollout-worker", ...
        id: unique among the services of its role.
        schema: version of the messages it speaks.
        build: of its rollout engine; of a tracer see `view_token`; "-" of all others.
    """

    role: str
    id: str
    schema: int
    build: str


def unique_name() -> str:
    """Return a name that no other process on any host has."""
    host = re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname()).strip("-")[:40]
    return f"{host or 'host'}-{os.getpid()}"


def is_here(name: str) -> bool:
    """Whether a name that `unique_name` made is of a process on this machine."""
    return name.rpartition("-")[0] == unique_name().rpartition("-")[0]


def view_token(page: int, data: int) -> str:
    """What a tracer has in place of a build: the ports of Rerun's page and of its data."""
    return f"view.{page}.{data}"


def view_ports(build: str) -> tuple[int, int] | None:
    """Return the ports of a tracer's token, None if it serves no page."""
    found = re.fullmatch(r"view\.(\d{1,5})\.(\d{1,5})", build)
    return None if found is None else (int(found[1]), int(found[2]))


def checked_name(kind: str, name: str) -> str:
    """Return a robot's, role's or service's name if it can be part of a key, else raise."""
    if not re.fullmatch(NAME_PATTERN, name):
        raise UsageError(
            f"{kind} {name!r} is not a valid name: up to 64 of A-Z a-z 0-9 . _ -, "
            "starting with a letter or a digit"
        )
    return name


def checked_robot(name: str) -> str:
    """Return a robot's name if it can be one, else raise."""
    if name == POOL:
        raise UsageError(
            f"robot {name!r}: the keys of rollout workers have this name; take another"
        )
    return checked_name("robot", name)


def checked_priority(priority: int) -> int:
    """Return a robot's priority if it can be one, else raise."""
    if not -PRIORITIES <= priority <= PRIORITIES:
        raise UsageError(f"priority must be from -{PRIORITIES} to {PRIORITIES}, got {priority}")
    return priority


def topic_key(robot: str, topic: str, address: str | None = None) -> str:
    """Key of a topic; `address` is one service's name, or ANY to subscribe to all of them."""
    key = f"sumo/v{SCHEMA}/{checked_name('robot', robot)}/{topic}"
    if address is None:
        return key
    return f"{key}/{address if address == ANY else checked_name('address', address)}"


def alive_key(robot: str, member: Member) -> str:
    """Key of a member's liveliness token."""
    role, name = checked_name("role", member.role), checked_name("id", member.id)
    prefix = f"sumo/alive/{checked_name('robot', robot)}"
    return f"{prefix}/{role}/{name}/{member.schema}/{quote(member.build, safe='')}"


def alive_keys(robot: str, role: str) -> str:
    """Key expression of the tokens of a role, or of ANY, at a robot's bus, or at that of ANY.

    Whatever their version and build.
    """
    robot = robot if robot == ANY else checked_name("robot", robot)
    role = role if role == ANY else checked_name("role", role)
    return f"sumo/alive/{robot}/{role}/*/*/*"


def parse_alive(key: str) -> Member | None:
    """Return the member that a liveliness key names; None if it is not one of ours."""
    return found[1] if (found := parse_presence(key)) is not None else None


def parse_presence(key: str) -> tuple[str, Member] | None:
    """Return the robot and the member that a liveliness key names; None if it is not of ours."""
    match key.split("/"):
        case ["sumo", "alive", robot, role, name, schema, build] if re.fullmatch(
            r"\d{1,9}", schema
        ):
            return robot, Member(role, name, int(schema), unquote(build))
    return None


def router_key(kind: str) -> str:
    """Key of a router's liveliness token.

    Args:
        kind: OPEN to this machine, SECURE by keys, or INSECURE: open to everybody.
    """
    return alive_key(POOL, Member(ROUTER, unique_name(), SCHEMA, kind))


def router_tokens() -> str:
    """Key expression of the tokens of routers."""
    return alive_keys(POOL, ROUTER)
