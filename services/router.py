"""The router that all services dial: Zenoh's router mode in this process, on one endpoint."""

import logging
import signal
import threading
from pathlib import Path

from sumo_dist.wire.session import DEFAULT_ENDPOINT, open_router

WAKE_S = 0.2  # a signal that another thread received is noticed when this one wakes

_log = logging.getLogger(__name__)


def serve(
    listen: str = DEFAULT_ENDPOINT,
    stop: threading.Event | None = None,
    config: Path | None = None,
) -> None:
    """Route between the clients of one endpoint until `stop` is set (None: until interrupted).

    Args:
        listen: endpoint; loopback unless the caller says otherwise.
        stop: ends the service.
        config: Zenoh configuration (JSON5) with TLS certificates and access rules.
    """
    with open_router(listen, config):
        _log.info("router listening on %s", listen)
        stop = stop or threading.Event()
        while not stop.wait(WAKE_S):
            pass


def run(listen: str = DEFAULT_ENDPOINT, config: Path | None = None) -> None:
    """Serve until SIGINT or SIGTERM."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        serve(listen, config=config)
    except KeyboardInterrupt:
        _log.info("router on %s stopped", listen)
    finally:
        signal.signal(signal.SIGTERM, before)
