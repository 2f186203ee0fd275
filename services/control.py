"""The operator's seat: a page in the browser that shows a session and steers it.

A client like any other: it hears what the tracer hears and says what `sumo-dist ctl` says. Without
it everything runs.
"""

import asyncio
import logging
import secrets
import socket
import ssl
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast, get_args

from sumo_dist.control.answer import Answer
from sumo_dist.dispatch import commander
from sumo_dist.dispatch.commander import Commander
from sumo_dist.episode.command import Verb
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.extras import need
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.finding import Search
from sumo_dist.wire.keys import OPERATOR, checked_name, unique_name

if TYPE_CHECKING:  # loaded when the service runs: other roles do not have it
    from aiohttp import web

LISTEN = "127.0.0.1:7480"
DRAIN = "drain"  # what the page says besides the verbs of a robot
STOP_S = 0.2  # between two looks whether to end

_log = logging.getLogger("sumo_dist.control")


@dataclass(frozen=True, kw_only=True)
class ControlOptions:
    """The operator's page.

    Attributes:
        connect: the router's endpoint; by default that of the run that is here.
        keys: folder from `sumo-dist keys host`, of the role operator, for a router with TLS; with
            one of the role tracer the page only shows.
        robot: its name on the bus; by default the one that is there.
        listen: address and port of the page, by default 127.0.0.1:7480, or a free port where that
            is taken. Beyond this machine a browser has to show the token of the address that is
            printed.
        https: folder with cert.pem and key.pem, to be reached by https.
        watch: only show, take no commands.
    """

    connect: str | None = None
    keys: Path | None = None
    robot: str | None = None
    listen: str | None = None
    https: Path | None = None
    watch: bool = False


def run(options: ControlOptions, stop: threading.Event) -> None:
    """Serve the page until told to stop.

    Raises:
        SumoError: there is no robot, the address is taken, or the extra is not installed.
    """
    need("control", "the control page")
    from sumo_dist.control.picture import SHOWN, Picture
    from sumo_dist.control.web import Access, ControlServer

    keys = keys_for(options.connect, options.keys, "operator", "tracer")
    watch = options.watch or (keys is not None and keys.certificate.role == "tracer")
    place = Search(options.connect, options.robot, keys).one()
    with listening(options.listen) as sock, Bus.dial(place.endpoint, place.robot, keys=keys) as bus:
        picture = Picture(place.robot)
        for kind in SHOWN:
            bus.subscribe(kind, picture.take)
        bus.watch(on_change=picture.member)
        beyond = not is_local(sock)
        access = Access(secrets.token_urlsafe(18), ()) if beyond else Access()
        give = None if watch else Giver(bus).give
        server = ControlServer(picture, give, access)
        bus.announce(keys.certificate.role if keys is not None else OPERATOR, unique_name())
        scheme = "http" if options.https is None else "https"
        _log.info(
            "%s the run at %s", "watch" if watch else "steer", _address(sock, scheme, access.token)
        )
        if beyond and options.https is None:
            _log.warning(
                "the page is open to the network without https: its token can be read there"
            )
        asyncio.run(_serve(server.app(), sock, _tls(options.https), stop))


class Giver:
    """Carries out what the page asks for."""

    def __init__(self, bus: Bus) -> None:
        """Speak on a robot's bus, to it and to the workers of its router."""
        self._robot, self._commander = bus.robot, Commander(bus)

    def give(self, verb: str, name: str, value: str) -> Answer:
        """Carry out a command."""
        if verb not in (DRAIN, *get_args(Verb)):
            return Answer(f"there is no command {verb!r}")
        try:
            if verb == DRAIN:
                gone = self._commander.drain(checked_name("worker", name))
                return Answer("" if gone else f"{name} is still there")
            ack = self._commander.give(cast(Verb, verb), name, value)
        except SumoError as error:  # the bus is being closed, or a text is too long
            return Answer(str(error))
        if ack is None:
            return Answer(f"{self._robot} did not answer within {commander.PATIENCE_S:g} s")
        return Answer(ack.refusal, ack.tick)


def listening(listen: str | None) -> socket.socket:
    """Return a socket that listens.

    Raises:
        SumoError: the address is taken, or not of this machine.
    """
    host, _, port = (listen or LISTEN).rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise UsageError(f"listen must be ADDRESS:PORT, such as {LISTEN}, got {listen!r}")
    family, reason = socket.AF_INET6 if ":" in host else socket.AF_INET, ""
    for number in (int(port),) if listen else (int(port), 0):
        sock = socket.socket(family, socket.SOCK_STREAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            sock.bind((host.strip("[]"), number))
            sock.listen(64)
        except OSError as error:
            sock.close()
            reason = error.strerror or str(error)
        else:
            return sock
    raise SumoError(f"cannot listen on {listen or LISTEN}: {reason}")


def is_local(sock: socket.socket) -> bool:
    """Whether only this machine reaches a socket."""
    host = sock.getsockname()[0]
    return host.startswith("127.") or host == "::1"


def _address(sock: socket.socket, scheme: str, token: str) -> str:
    host, port = sock.getsockname()[:2]
    if host in ("0.0.0.0", "::"):
        host = socket.gethostname()
    shown = f"[{host}]" if ":" in host else host
    return f"{scheme}://{shown}:{port}/" + (f"?token={token}" if token else "")


def _tls(folder: Path | None) -> ssl.SSLContext | None:
    if folder is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(folder / "cert.pem", folder / "key.pem")
    except (OSError, ssl.SSLError) as error:
        raise UsageError(f"{folder} has no cert.pem and key.pem that fit: {error}") from None
    return context


async def _serve(
    app: "web.Application", sock: socket.socket, tls: ssl.SSLContext | None, stop: threading.Event
) -> None:
    from aiohttp import web

    runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=0.5)
    await runner.setup()
    try:
        await web.SockSite(runner, sock, ssl_context=tls).start()
        while not stop.is_set():
            await asyncio.sleep(STOP_S)
    finally:
        await runner.cleanup()
