"""Zenoh sessions with safe settings: nothing is announced, discovered or shared unasked.

One router, everybody else a client that dials it. Zenoh's own defaults (listen on all interfaces,
multicast, gossip, shared memory, a lease of 10 s) are all overridden.
"""

import json
import re
import time
from pathlib import Path
from typing import Any

import zenoh

from sumo_dist.errors import SumoError, UsageError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

_ENDPOINT = r"(tcp|tls|quic)/(\[[0-9A-Fa-f:.]+\]|[\w.-]+):(?P<port>\d{1,5})([?#]\S*)?"
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
                raise SumoError(
                    f"no router at {endpoint} (waited {timeout:g} s): "
                    f"start one with `sumo-dist router --listen {endpoint}`"
                ) from None


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
