"""A real cable between this machine and a few processes, which can be unplugged.

The processes run in a network namespace of their own; a pair of virtual Ethernet devices joins it
to the machine's. Nothing but loopback and that pair is touched, and both are removed again.
"""

import ipaddress
import json
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Self

import numpy as np

from sumo_dist.errors import SumoError, UsageError

RANGE = ipaddress.IPv4Network("169.254.0.0/16")  # of links that nobody routes
_COMMAND_S = 10.0


class Cable:
    """A namespace and the cable to it. A context manager; close it after its processes.

    Attributes:
        host: address of this machine's end.
        prefix: command before that of a process at the far end.
    """

    def __init__(self) -> None:
        """Name what is to be made.

        Raises:
            UsageError: this is not Linux, there is no `ip`, or the user is not root.
        """
        if sys.platform != "linux":
            raise UsageError("services can be set apart on Linux only")
        if os.geteuid() != 0:
            raise UsageError("setting services apart needs root, for a network of their own")
        if (tool := shutil.which("ip")) is None:
            raise UsageError("setting services apart needs the command ip (iproute2)")
        self._ip = tool
        self._space = f"sumo-{os.getpid()}"
        self._near, self._far = (
            f"sumo{os.getpid()}n",
            f"sumo{os.getpid()}f",
        )  # at most 15 characters
        self.prefix = (tool, "netns", "exec", self._space)
        self.host, self._there, self._bits = "", "", 30

    def __enter__(self) -> Self:
        taken = *Path("/run/netns").glob(self._space), *Path("/sys/class/net").glob(self._near)
        if taken:
            raise SumoError(f"{taken[0]} is there already, of a process of the same number")
        with ExitStack() as stack:
            stack.callback(self._remove)
            self._lay()
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._remove()

    def unplug(self) -> None:
        """Set the far end down."""
        self._run("-n", self._space, "link", "set", self._far, "down")

    def plug_in(self) -> None:
        """Set the far end up."""
        self._run("-n", self._space, "link", "set", self._far, "up")

    def _lay(self) -> None:
        network = free_network(self._taken())
        self.host, self._there = (str(address) for address in network.hosts())
        far = ("-n", self._space)
        self._run("netns", "add", self._space)
        pair = ("type", "veth", "peer", "name", self._far, "netns", self._space)
        self._run("link", "add", self._near, *pair)
        self._run("addr", "add", f"{self.host}/{self._bits}", "dev", self._near)
        self._run(*far, "addr", "add", f"{self._there}/{self._bits}", "dev", self._far)
        self._run("link", "set", self._near, "up")
        self._run(*far, "link", "set", "lo", "up")
        self.plug_in()

    def _remove(self) -> None:
        """Remove what there is of it; the cable goes with either of its ends."""
        with suppress(SumoError):
            self._run("link", "delete", self._near)
        with suppress(SumoError):
            self._run("netns", "delete", self._space)

    def _taken(self) -> list[ipaddress.IPv4Network]:
        """Networks that this machine reaches."""
        routes = json.loads(self._run("-j", "-4", "route", "show", "table", "all") or "[]")
        named = (route.get("dst", "") for route in routes)
        return [
            ipaddress.IPv4Network(name, strict=False)
            for name in named
            if name not in ("", "default")
        ]

    def _run(self, *arguments: str) -> str:
        try:
            done = subprocess.run(
                [self._ip, *arguments],
                capture_output=True,
                text=True,
                check=False,
                start_new_session=True,  # Ctrl-C must not stop the removal
                timeout=_COMMAND_S,
            )
        except subprocess.TimeoutExpired:
            raise SumoError(f"ip {' '.join(arguments)}: no answer") from None
        if done.returncode:
            raise SumoError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")
        return done.stdout


def free_network(taken: list[ipaddress.IPv4Network]) -> ipaddress.IPv4Network:
    """Return a network of two hosts that overlaps none of those that are taken."""
    rng = np.random.default_rng()
    for _ in range(100):
        first = RANGE.network_address + 4 * int(rng.integers(64, RANGE.num_addresses // 4 - 64))
        network = ipaddress.IPv4Network(f"{first}/30")
        if not any(network.overlaps(other) for other in taken):
            return network
    raise SumoError(f"no free network in {RANGE}: all seem to be routed here")
