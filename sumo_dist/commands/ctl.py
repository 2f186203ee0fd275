"""`sumo-dist ctl`, `stop` and `resume`: commands to a robot that works, from any terminal."""

import re
import secrets
import time
from dataclasses import dataclass
from typing import Annotated, get_args

import tyro

from sumo_dist.episode.command import Verb
from sumo_dist.errors import SumoError, UsageError, unknown
from sumo_dist.provenance import user_name
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import Ack, CommandMessage
from sumo_dist.wire.session import DEFAULT_ENDPOINT

AGAIN_S = 0.1  # a command that is not answered is sent again; the robot carries it out once
PATIENCE_S = 5.0

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


@dataclass(frozen=True)
class Options:
    """Options of `stop` and `resume`.

    Attributes:
        connect: the router's endpoint.
        robot: its name on the bus.
        reason: for the people who ask later.
    """

    connect: str = DEFAULT_ENDPOINT
    robot: str = "spot"
    reason: str = ""


@dataclass(frozen=True)
class CtlOptions:
    """Options of `ctl`.

    Attributes:
        words: what to do: pause, resume, step [TICKS], reset [SEED], task TASK [SEED], weight
            NAME=VALUE, parameter NAME=VALUE, planner NAME=VALUE, stop [REASON...] or stand.
        connect: the router's endpoint.
        robot: its name on the bus.
    """

    words: Annotated[tuple[str, ...], tyro.conf.Positional]
    connect: str = DEFAULT_ENDPOINT
    robot: str = "spot"


def stop(options: Options) -> int:
    """Make the robot sit down, whatever it does."""
    return _command(options.connect, options.robot, "stop", value=options.reason)


def resume(options: Options) -> int:
    """Let a robot that has stopped get up and go on."""
    return _command(options.connect, options.robot, "stand")


def main(options: CtlOptions) -> int:
    """Give a command and say what came of it."""
    if not options.words or options.words[0] not in WORDS:
        raise unknown("command", " ".join(options.words[:1]), get_args(Verb))
    verb, *words = options.words
    name, value = _parsed(verb, words)
    return _command(options.connect, options.robot, verb, name, value)  # pyright: ignore[reportArgumentType]


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


def _command(endpoint: str, robot: str, verb: Verb, name: str = "", value: str = "") -> int:
    """Send a command until the robot answers."""
    user = re.sub(r"[^A-Za-z0-9-]", "-", user_name()).strip("-")[:40] or "somebody"
    sender = f"{user}-{secrets.token_hex(3)}"
    message = CommandMessage("any", 0, sender, verb, name, value)
    with Bus.dial(endpoint, robot) as bus:
        answers = bus.newest(Ack, address=sender)
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            bus.publish(message)
            if (ack := answers.wait(AGAIN_S)) is not None:
                if ack.refusal:
                    raise SumoError(f"{robot} refuses to {verb}: {ack.refusal}")
                print(f"{robot}: {verb} at tick {ack.tick}")
                return 0
    raise SumoError(f"{robot} did not answer within {PATIENCE_S:g} s: it is not at {endpoint}")
