"""A real link between this machine and a few processes, which can be unplugged (Linux, root).

The processes run in a network namespace; a pair of virtual Ethernet devices joins it to the
machine's network. Nothing but loopback and that pair is touched, and both are removed again.
"""

import ipaddress
import json
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack, suppress
from typing import Self

import numpy as np

from sumo_dist.errors import SumoError, UsageError

RANGE = ipaddress.IPv4Network("169.254.0.0/16")  # link-local: not routed
COMMAND_S = 10.0  # an `ip` command that takes longer has failed


class NetnsLink:
    """A namespace and the link to it. A context manager; close it after its processes.

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
        if (ip := shutil.which("ip")) is None:
            raise UsageError("setting services apart needs the command ip (iproute2)")
        self._ip, self._stack = ip, ExitStack()
        self._space = f"sumo-{os.getpid()}"
        self._near, self._far = (f"sumo{os.getpid()}{end}" for end in "nf")  # 15 characters at most
        self.host, self.prefix = "", (ip, "netns", "exec", self._space)

    def __enter__(self) -> Self:
        with self._stack as stack:  # if a step fails, what was made before is removed
            self._run("netns", "add", self._space)
            stack.callback(self._remove, "netns", self._space)
            pair = ("type", "veth", "peer", "name", self._far, "netns", self._space)
            self._run("link", "add", self._near, *pair)
            stack.callback(self._remove, "link", self._near)  # the far end goes with it
            self._connect()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def unplug(self) -> None:
        """Set the far end down."""
        self._run("-n", self._space, "link", "set", self._far, "down")

    def plug_in(self) -> None:
        """Set the far end up."""
        self._run("-n", self._space, "link", "set", self._far, "up")

    def _connect(self) -> None:
        routes = json.loads(self._run("-j", "-4", "route", "show", "table", "all") or "[]")
        names = [route.get("dst", "") for route in routes]
        taken = [ipaddress.IPv4Network(n, strict=False) for n in names if n not in ("", "default")]
        self.host, far_host = map(str, free_network(taken).hosts())
        self._run("addr", "add", f"{self.host}/30", "dev", self._near)
        self._run("-n", self._space, "addr", "add", f"{far_host}/30", "dev", self._far)
        self._run("link", "set", self._near, "up")
        self._run("-n", self._space, "link", "set", "lo", "up")
        self.plug_in()

    def _remove(self, kind: str, name: str) -> None:
        with suppress(SumoError):
            self._run(kind, "delete", name)

    def _run(self, *arguments: str) -> str:
        command = f"ip {' '.join(arguments)}"
        try:
            done = subprocess.run(
                [self._ip, *arguments],
                capture_output=True,
                text=True,
                check=False,
                start_new_session=True,  # Ctrl-C must not stop the removal
                timeout=COMMAND_S,
            )
        except subprocess.TimeoutExpired:
            raise SumoError(f"{command}: no answer") from None
        if done.returncode:
            raise SumoError(f"{command}: {done.stderr.strip()}")
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
