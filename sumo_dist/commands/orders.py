"""`sumo-dist stop` and `sumo-dist resume`: orders to a running robot from any terminal."""

import getpass
import re
import time
from dataclasses import dataclass
from typing import Literal

from sumo_dist.errors import SumoError
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import Health, Order
from sumo_dist.wire.session import DEFAULT_ENDPOINT

AGAIN_S = 0.05
PATIENCE_S = 5.0
OBEYED = {"stop": ("stopping", "stopped"), "resume": ("rising", "running")}


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


def stop(options: Options) -> int:
    """Make the robot sit down, whatever it does."""
    return _order("stop", options)


def resume(options: Options) -> int:
    """Let a robot that has stopped get up and go on."""
    return _order("resume", options)


def _order(action: Literal["stop", "resume"], options: Options) -> int:
    """Repeat an order until the robot obeys."""
    source = re.sub(r"[^A-Za-z0-9-]", "-", getpass.getuser()).strip("-")[:40] or "somebody"
    order = Order("any", source, action, options.reason)
    with Bus.dial(options.connect, options.robot) as bus:
        health = bus.newest(Health, address="robot")
        deadline, mode = time.monotonic() + PATIENCE_S, None
        while time.monotonic() < deadline:
            bus.publish(order)
            said = health.wait(AGAIN_S)
            mode = said.mode if said is not None else mode
            if mode in OBEYED[action]:
                print(f"{options.robot}: {mode}")
                return 0
    heard = f"it says {mode!r}" if mode else "it says nothing"
    raise SumoError(f"{options.robot} did not {action} within {PATIENCE_S:g} s: {heard}")
