"""The router that all services dial: Zenoh's router mode in this process.

With keys it has an access list, see `wire.access`. Zenoh reads that once, when a session opens: to
refuse a certificate that was revoked meanwhile, the session is opened anew, and every service dials
again by itself, within half a second.
"""

import logging
import threading
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from sumo_dist.authority.certificates import ROUTER, KeysError
from sumo_dist.authority.store import read_revoked
from sumo_dist.errors import UsageError
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.session import (
    DEFAULT_ENDPOINT,
    checked_endpoint,
    checked_open,
    is_loopback,
    is_secure,
    open_router,
)

WAKE_S = 0.2  # a signal that another thread received is noticed when this one wakes

_log = logging.getLogger("sumo_dist.router")


@dataclass(frozen=True)
class RouterOptions:
    """A router.

    Attributes:
        listen: endpoint; beyond this machine with TLS and keys, such as tls/0.0.0.0:7447.
        local: a second endpoint, on loopback, where the services of this machine need no keys, such
            as tcp/127.0.0.1:7448.
        keys: folder of this host's router from `sumo-dist keys host`, for endpoints with TLS.
        insecure: let anybody in without keys, on any endpoint: who reaches it owns the robots.
    """

    listen: str = DEFAULT_ENDPOINT
    local: str | None = None
    keys: Path | None = None
    insecure: bool = False

    def __post_init__(self) -> None:
        checked_open([self.listen], self.insecure)
        if self.local is None:
            return
        if is_secure(self.local) or not is_loopback(checked_endpoint(self.local)):
            raise UsageError(f"local must be on loopback, tcp/127.0.0.1:PORT, got {self.local}")


def serve(options: RouterOptions, stop: threading.Event) -> None:
    """Route until told to stop.

    Raises:
        KeysError: the keys are not fit for it.
        SumoError: an endpoint is taken.
    """
    where = options.listen if options.local is None else f"{options.listen} and {options.local}"
    while not stop.is_set():
        revoked = revoked_by(options)
        with opened(options, revoked):
            _log.info("router listening on %s", where)
            if options.insecure:
                _log.warning("INSECURE: whoever reaches %s owns the robots here", where)
            while not stop.wait(WAKE_S) and revoked_by(options, revoked) == revoked:
                pass
        if not stop.is_set():
            _log.warning("the list of revoked keys has changed: all services dial again")


def opened(options: RouterOptions, revoked: frozenset[str]) -> AbstractContextManager[None]:
    """Be the router while this lasts, see `open_router`.

    Args:
        options: the router's.
        revoked: common names of certificates that are not accepted.
    """
    return open_router(
        options.listen,
        local=options.local,
        keys=keys_for(options.listen, options.keys, ROUTER),
        revoked=revoked,
        insecure=options.insecure,
    )


def revoked_by(options: RouterOptions, before: frozenset[str] | None = None) -> frozenset[str]:
    """Return whom the router's folder says to refuse.

    While it runs, a list that cannot be read is as it was `before`: it is being copied.
    """
    if options.keys is None or not is_secure(options.listen):
        return frozenset()
    try:
        return read_revoked(options.keys)
    except KeysError:
        if before is None:
            raise
        return before
