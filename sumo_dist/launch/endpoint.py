"""The endpoint that a router of this machine gets: the given one, or one that is free."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from sumo_dist.errors import SumoError
from sumo_dist.launch.launcher import dialled, listening
from sumo_dist.wire.routers import LocalRouter, left_note, local_routers
from sumo_dist.wire.session import DEFAULT_ENDPOINT, is_free, port_of

_TRIES = 20
_ANY_FREE = "tcp/127.0.0.1:0"


@contextmanager
def router_endpoint(listen: str | None, what: str) -> Iterator[str]:
    """Have an endpoint for a router, and a file that says where it is, see `wire.routers`.

    Args:
        listen: where to listen; None takes the usual port, or a free one where that is taken.
        what: the router is for, in a few words for people.

    Raises:
        UsageError: `listen` is not an endpoint.
        SumoError: its port is taken.
    """
    choices = [listen] if listen is not None else [DEFAULT_ENDPOINT, *[_ANY_FREE] * _TRIES]
    endpoints = map(listening, choices)
    with ExitStack() as stack:
        endpoint = next(endpoints)
        while not _is_ours(endpoint, what, stack):
            stack.close()
            if (another := next(endpoints, None)) is None:
                raise SumoError(
                    f"cannot listen on {endpoint}: the port is taken, {_holder(endpoint)}"
                )
            endpoint = another
        yield endpoint


def _is_ours(endpoint: str, what: str, stack: ExitStack) -> bool:
    """Leave the router's file; return whether nobody else has the port."""
    # Two runs that begin at once may both find the port free; only one of them has the file.
    note = LocalRouter(dialled(endpoint), what, os.getpid())
    return stack.enter_context(left_note(note)) and is_free(endpoint)


def _holder(endpoint: str) -> str:
    """Who has a port, as far as is known."""
    for router in local_routers():
        if port_of(router.endpoint) == port_of(endpoint):
            return f"by {router.what or 'a router'} (process {router.pid})"
    return "perhaps by another router"
