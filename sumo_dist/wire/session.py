"""Zenoh sessions with safe settings: nothing is announced, discovered or shared unasked.

One router, everybody else a client that dials it. Zenoh's own defaults (listen on all interfaces,
multicast, gossip, shared memory, a lease of 10 s) are all overridden.
"""

import errno
import json
import re
import socket
import time
from pathlib import Path
from typing import Any

import zenoh

from sumo_dist.errors import SumoError, UsageError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

_ENDPOINT = r"(tcp|tls|quic)/(?P<host>\[[0-9A-Fa-f:.]+\]|[\w.-]+):(?P<port>\d{1,5})([?#]\S*)?"
_PROBE_S = 0.3
_ATTEMPT_MS = 1000  # per try to connect: a frozen router accepts and never answers
_COMMON = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/tx/lease": 1000,  # [ms] until a silent peer counts as gone
    # room for a burst of requests on a busy machine: the default of 2 and 1 ms loses some of 8
    "transport/link/tx/queue/size/real_time": 16,
    "transport/link/tx/queue/size/background": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 5000,  # [us]
}


def open_client(endpoint: str, timeout: float, config: Path | None = None) -> zenoh.Session:
    """Dial a router, waiting for it to come up.

    The session redials by itself, within half a second, whenever the router comes back, and then
    everything declared on it is declared again.

    Args:
        endpoint: of the router, such as "tcp/127.0.0.1:7447".
        timeout: how long to wait for it [s].
        config: Zenoh configuration (JSON5) that these settings are laid over, for TLS.
    """
    settings = {
        "mode": "client",
        "connect/endpoints": [checked_endpoint(endpoint)],
        "listen/endpoints": [],
        "connect/timeout_ms": _ATTEMPT_MS,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 500,
            "period_increase_factor": 1.5,
        },
    }
    deadline = time.monotonic() + timeout
    while True:
        settings["connect/timeout_ms"] = _clamped_ms(deadline - time.monotonic())
        try:
            return zenoh.open(_configuration(settings, config))
        except zenoh.ZError:
            if time.monotonic() >= deadline:
                raise no_router(endpoint, timeout) from None


def no_router(endpoint: str, waited: float) -> SumoError:
    """Build the error for a router that did not come within some seconds."""
    return SumoError(
        f"no router at {endpoint} (waited {waited:g} s): "
        f"start one with `sumo-dist router --listen {endpoint}`"
    )


def open_router(listen: str, config: Path | None = None) -> zenoh.Session:
    """Be the router on one endpoint.

    Args:
        listen: endpoint to accept clients on.
        config: Zenoh configuration (JSON5) that these settings are laid over, for TLS and access
            rules.
    """
    listening = [checked_endpoint(listen)]
    settings = {"mode": "router", "listen/endpoints": listening, "connect/endpoints": []}
    try:
        return zenoh.open(_configuration(settings, config))
    except zenoh.ZError as error:
        cause = "the port is taken, perhaps by another router" if "in use" in str(error) else error
        raise SumoError(f"cannot listen on {listen}: {cause}") from None


def _clamped_ms(seconds: float) -> int:
    return max(1, min(_ATTEMPT_MS, round(seconds * 1000)))


def _configuration(settings: dict[str, Any], config: Path | None) -> zenoh.Config:
    try:
        merged = zenoh.Config() if config is None else zenoh.Config.from_file(config)
    except zenoh.ZError as error:
        raise UsageError(f"{config} is not a Zenoh configuration: {error}") from None
    for key, value in {**_COMMON, **settings}.items():
        merged.insert_json5(key, json.dumps(value))
    return merged


def checked_endpoint(endpoint: str) -> str:
    """Return an endpoint if it is one, else raise."""
    match = re.fullmatch(_ENDPOINT, endpoint)
    if match is None or not 0 < int(match["port"]) < 2**16:
        raise UsageError(
            f"{endpoint!r} is not an endpoint; valid: tcp/HOST:PORT, tls/HOST:PORT "
            f"or quic/HOST:PORT, such as {DEFAULT_ENDPOINT}"
        )
    return endpoint


def port_of(endpoint: str) -> int:
    """Return the port of an endpoint."""
    return _address(endpoint)[1]


def nobody_listens(endpoint: str) -> bool:
    """Whether a machine refuses the connection at once; Zenoh would try again until its timeout."""
    if endpoint.startswith("quic/"):  # it has no connections to refuse
        return False
    try:
        socket.create_connection(_address(endpoint), _PROBE_S).close()
    except ConnectionRefusedError:
        return True
    except OSError:
        return False
    return False


def is_free(endpoint: str) -> bool:
    """Whether nobody on this machine listens on an endpoint; True where that cannot be told."""
    kind = socket.SOCK_DGRAM if endpoint.startswith("quic/") else socket.SOCK_STREAM
    try:
        family, *_, address = socket.getaddrinfo(*_address(endpoint), type=kind)[0]
        with socket.socket(family, kind) as probe:
            if kind == socket.SOCK_STREAM:  # a port that was left a moment ago is free
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        return error.errno != errno.EADDRINUSE
    return True


def _address(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint."""
    match = re.fullmatch(_ENDPOINT, checked_endpoint(endpoint))
    assert match is not None, "it was checked"
    return match["host"].strip("[]"), int(match["port"])
