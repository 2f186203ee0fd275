"""Zenoh sessions with safe settings: nothing is announced, discovered or shared unasked.

One router, everybody else a client that dials it. Zenoh's own defaults (listen on all interfaces,
multicast, gossip, shared memory, a lease of 10 s) are all overridden. What leaves this machine
needs keys, see `wire.tls` and `wire.access`.
"""

import errno
import ipaddress
import json
import re
import socket
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from sumo_dist.authority.certificates import KeysError
from sumo_dist.authority.folder import KeyFolder
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.wire.access import access_control, size_limits
from sumo_dist.wire.keys import INSECURE, OPEN, SECURE, router_key, router_tokens
from sumo_dist.wire.schema import MAX_BYTES
from sumo_dist.wire.tls import client_settings, router_settings, why_not

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"

_ENDPOINT = r"(tcp|tls)/(?P<host>\[[0-9A-Fa-f:.]+\]|[\w.-]+):(?P<port>\d{1,5})([?#]\S*)?"
_PROBE_S = 0.3
_ATTEMPT_MS = 1000  # per try to connect: a frozen router accepts and never answers
_ADMITTED_S = 5.0  # a router that admits a client says so in milliseconds
_HEADERS = 64 << 10  # what a message may have beside its payload [bytes]
_COMMON = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # nothing is scouted, so that a router need not wait for it
    "transport/shared_memory/enabled": False,
    "transport/link/protocols": ["tcp", "tls"],
    "transport/link/tx/lease": 1000,  # [ms] until a silent peer counts as gone
    # room for a burst of requests on a busy machine: the default of 2 and 1 ms loses some of 8
    "transport/link/tx/queue/size/real_time": 16,
    "transport/link/tx/queue/size/background": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 5000,  # [us]
    "transport/link/rx/max_message_size": MAX_BYTES + _HEADERS,
}
_BOUNDS = {  # of a router: who opens many connections keeps nobody else out for long
    "transport/unicast/max_sessions": 600,
    "transport/unicast/accept_pending": 200,
    "transport/unicast/accept_timeout": 3000,  # [ms]
}


def open_client(endpoint: str, timeout: float, keys: KeyFolder | None = None) -> zenoh.Session:
    """Dial a router, waiting for it to come up.

    The session redials by itself, within half a second, whenever the router comes back, and then
    everything declared on it is declared again.

    Args:
        endpoint: of the router, such as "tcp/127.0.0.1:7447".
        timeout: how long to wait for it [s].
        keys: of this service, which endpoints with tls need; tcp makes no use of them.

    Raises:
        SumoError: there is no router.
        KeysError: there is one, and one side refuses the other's keys.
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
    if is_secure(endpoint):
        settings |= client_settings(needed(keys, endpoint))
    deadline = time.monotonic() + timeout
    while True:
        settings["connect/timeout_ms"] = _clamped_ms(deadline - time.monotonic())
        try:
            session = zenoh.open(_configuration(settings))
            break
        except zenoh.ZError:
            if reason := why_not(endpoint, _address(endpoint), keys):
                raise KeysError(reason) from None
            if time.monotonic() >= deadline:
                raise no_router(endpoint, timeout) from None
    if is_secure(endpoint):
        _check_admitted(session, endpoint, keys)
    return session


def needed(keys: KeyFolder | None, endpoint: str) -> KeyFolder:
    """Return the keys for an endpoint with TLS.

    Raises:
        UsageError: there are none.
    """
    if keys is None:
        raise UsageError(
            f"{endpoint} needs --keys DIR, a folder that `sumo-dist keys host` has made for this "
            "host and role"
        )
    return keys


def _check_admitted(session: zenoh.Session, endpoint: str, keys: KeyFolder | None) -> None:
    """Make sure that the router lets these keys take part: whom it does not, it leaves mute."""
    try:
        replies = session.liveliness().get(router_tokens(), timeout=_ADMITTED_S)
        if any(reply.ok is not None for reply in replies):
            return
    except zenoh.ZError as error:
        session.close()
        raise SumoError(f"{endpoint} was there and is gone: {error}") from None
    session.close()
    path = keys.path if keys is not None else "(none)"
    raise KeysError(
        f"the router at {endpoint} does not admit the keys in {path}: they were revoked, or its "
        "role has nothing to do there; `sumo-dist keys show` where the authority is"
    )


def no_router(endpoint: str, waited: float) -> SumoError:
    """Build the error for a router that did not come within some seconds."""
    return SumoError(
        f"no router at {endpoint} (waited {waited:g} s): "
        f"start one with `sumo-dist router --listen {endpoint}`"
    )


@contextmanager
def open_router(
    listen: str,
    *,
    local: str | None = None,
    keys: KeyFolder | None = None,
    revoked: Collection[str] = (),
    insecure: bool = False,
) -> Iterator[None]:
    """Be the router while this lasts.

    Args:
        listen: endpoint to accept clients on; beyond loopback with TLS.
        local: endpoint on loopback where clients of this machine need no keys, if there is one.
        keys: of the router, for endpoints with TLS.
        revoked: common names of certificates that are not accepted.
        insecure: accept everybody, on any endpoint.

    Raises:
        UsageError: everybody who reaches it would own the robots there.
        SumoError: an endpoint is taken.
    """
    endpoints = [listen, *([local] if local is not None else [])]
    checked_open(endpoints, insecure)
    settings = {"mode": "router", "listen/endpoints": endpoints, "connect/endpoints": [], **_BOUNDS}
    secure = any(map(is_secure, endpoints))
    if secure:
        settings |= router_settings(needed(keys, listen))
        settings |= {"access_control": access_control(revoked), "low_pass_filter": size_limits()}
    try:
        session = zenoh.open(_configuration(settings))
    except zenoh.ZError as error:
        cause = "the port is taken, perhaps by another router" if "in use" in str(error) else error
        raise SumoError(f"cannot listen on {listen}: {cause}") from None
    open_to_all = insecure and not all(is_secure(e) or is_loopback(e) for e in endpoints)
    kind = INSECURE if open_to_all else SECURE if secure else OPEN
    with session, session.liveliness().declare_token(router_key(kind)):
        yield


def checked_open(endpoints: Collection[str], insecure: bool) -> None:
    """Make sure that nobody beyond this machine gets in without keys, unless that is wanted.

    Raises:
        UsageError: somebody would.
    """
    for endpoint in map(checked_endpoint, endpoints):
        if not (insecure or is_secure(endpoint) or is_loopback(endpoint)):
            secure = endpoint.replace("tcp/", "tls/", 1)
            raise UsageError(
                f"{endpoint} is open to everybody who reaches this machine, and who gets in owns "
                f"the robot: listen on {secure} with --keys DIR (see `sumo-dist keys`), or say "
                "--insecure on a network that is yours alone"
            )


def _clamped_ms(seconds: float) -> int:
    return max(1, min(_ATTEMPT_MS, round(seconds * 1000)))


def _configuration(settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in {**_COMMON, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def checked_endpoint(endpoint: str) -> str:
    """Return an endpoint if it is one, else raise."""
    match = re.fullmatch(_ENDPOINT, endpoint)
    if match is None or not 0 < int(match["port"]) < 2**16:
        raise UsageError(
            f"{endpoint!r} is not an endpoint; valid: tcp/HOST:PORT or tls/HOST:PORT, such as "
            f"{DEFAULT_ENDPOINT}"
        )
    return endpoint


def is_secure(endpoint: str) -> bool:
    """Whether an endpoint asks for keys."""
    return checked_endpoint(endpoint).startswith("tls/")


def is_loopback(endpoint: str) -> bool:
    """Whether only this machine reaches an endpoint."""
    host, _ = _address(endpoint)
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def port_of(endpoint: str) -> int:
    """Return the port of an endpoint."""
    return _address(endpoint)[1]


def nobody_listens(endpoint: str) -> bool:
    """Whether a machine refuses the connection at once; Zenoh would try again until its timeout."""
    try:
        socket.create_connection(_address(endpoint), _PROBE_S).close()
    except ConnectionRefusedError:
        return True
    except OSError:
        return False
    return False


def is_free(endpoint: str) -> bool:
    """Whether nobody on this machine listens on an endpoint; True where that cannot be told."""
    try:
        family, *_, address = socket.getaddrinfo(*_address(endpoint), type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            # a port that was left a moment ago is free
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
