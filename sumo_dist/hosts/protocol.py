"""What the launcher of a run and the agents on its hosts say to each other: a JSON object a line.

To an agent: `{"start": [...]}`, services to start; `{"stop": true}`; `{"alive": true}`, and that at
least once a second, for the agent ends its services when it hears nothing. From an agent, all with
an "event": "hello" with what it is; "alive"; "log" with what a service says; "ready" of a service
that listens; "ended" with a service's exit code; "stopped" when no service is left.
"""

import json
from dataclasses import asdict, dataclass
from typing import Any, Self

from sumo_dist.errors import SumoError

BEAT_S = 1.0
SILENCE_S = 5.0  # without a word: the other side is gone, whatever TCP still hopes for
LONGEST = 1 << 20  # of a line [bytes]


@dataclass(frozen=True)
class Order:
    """A service to be started.

    Attributes:
        name: unique on its host.
        command: subcommand of sumo-dist.
        words: of its options.
        listens: endpoint at which it answers once it is ready; "" if it has none.
    """

    name: str
    command: str
    words: tuple[str, ...]
    listens: str = ""

    @classmethod
    def parsed(cls, said: dict[str, Any]) -> Self:
        """Read what `asdict` made of one."""
        return cls(said["name"], said["command"], tuple(said["words"]), said["listens"])


def starting(orders: list[Order]) -> dict[str, Any]:
    """Say which services to start."""
    return {"start": [asdict(order) for order in orders]}


def encoded(message: dict[str, Any]) -> bytes:
    """Return a message as a line."""
    return json.dumps(message).encode() + b"\n"


def decoded(line: bytes) -> dict[str, Any]:
    """Read a line.

    Raises:
        SumoError: it is no message.
    """
    try:
        message = json.loads(line)
    except ValueError:
        message = None
    if not isinstance(message, dict):
        raise SumoError("it does not speak as an agent of this version")
    return message
