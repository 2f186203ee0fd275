"""The operator's page and its line to the session: one HTTP server, on loopback unless told.

Whoever opens `/live`, a WebSocket, is sent `{"steers": ...}` once, `{"offer": ...}` once an
episode, `{"picture": ...}` some times a second, and `{"answer": ...}` to each `{"id", "verb",
"name", "value"}` that it sends. Verbs are those of `sumo-dist ctl`.
"""

import asyncio
import json
import secrets
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from aiohttp import WSMsgType, web

from sumo_dist.control.answer import Answer
from sumo_dist.control.picture import Picture
from sumo_dist.control.rerun_proxy import RerunProxy

PERIOD_S = 0.1  # between two pictures
PAGE = Path(__file__).with_name("page")
LOCAL = ("localhost", "127.0.0.1", "::1")
COOKIE = "sumo-dist"
STOPS = 4  # that may wait for their answers at once; other commands go one after the other
LONGEST = 4096  # bytes of a command

Give = Callable[[str, str, str], Answer] | None
"""(verb, name, value) -> what came of it; None: the page only shows"""
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True)
class Access:
    """Who may open the page.

    Attributes:
        token: that a browser must show once; "" on loopback, where it needs none.
        names: of this machine, by which a browser may address it; () for any.
    """

    token: str = ""
    names: tuple[str, ...] = LOCAL

    def refusal(self, request: web.Request) -> str:
        """Say why a request is not answered, "" if it is.

        A page of another site must not reach a server of this machine by the browser of somebody
        who is here: neither under a name of its own, nor by a WebSocket, which needs no permission.
        """
        host = urlsplit(f"//{request.host}").hostname or ""
        if self.names and host not in self.names:
            return f"this server is not called {host}"
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            return f"a page of {origin} may not steer this robot"
        shown = request.query.get("token") or request.cookies.get(COOKIE, "")
        if self.token and not secrets.compare_digest(shown.encode(), self.token.encode()):
            return "open the address with the token that `sumo-dist control` printed"
        return ""


class ControlServer:
    """Serves the page; see the module."""

    def __init__(self, picture: Picture, give: Give, access: Access) -> None:
        """Prepare.

        Args:
            picture: of the session.
            give: carries a command out; may take seconds, and is called by threads of this.
            access: who may open the page.
        """
        self._picture, self._give, self._access = picture, give, access
        self._clients: set[web.WebSocketResponse] = set()
        self._commands = ThreadPoolExecutor(1, "command")
        self._stops = ThreadPoolExecutor(STOPS, "stop")
        self._rerun = RerunProxy(lambda: picture.view)
        self._made = 0.0, ""  # the newest picture, and when it was made

    def app(self) -> web.Application:
        """Return the application."""

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            return await self._guarded(request, handler)

        app = web.Application(middlewares=[guard])
        app.router.add_get("/", self._index)
        app.router.add_get("/live", self._live)
        app.router.add_static("/page/", PAGE)
        self._rerun.add_to(app)
        app.on_shutdown.append(self._close)
        return app

    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if reason := self._access.refusal(request):
            return web.Response(status=403, text=f"{reason}\n")
        response = await handler(request)
        if not response.prepared and request.query.get("token"):
            secure = request.scheme == "https"
            token = self._access.token
            response.set_cookie(COOKIE, token, httponly=True, samesite="Strict", secure=secure)
        return response

    async def _index(self, request: web.Request) -> web.StreamResponse:
        """Answer with the page, which no other page may frame: a click there would be one here."""
        own = f"default-src 'self'; connect-src 'self' ws://{request.host} wss://{request.host}"
        view = "frame-src 'self' " + " ".join(f"http://{name}:*" for name in LOCAL[:2])
        policy = f"{own}; {view}; img-src data:; frame-ancestors 'none'"
        headers = {"Cache-Control": "no-cache", "Content-Security-Policy": policy}
        return web.FileResponse(PAGE / "index.html", headers=headers)

    async def _live(self, request: web.Request) -> web.StreamResponse:
        """Tell a client what there is until it leaves, and take its commands."""
        socket = web.WebSocketResponse(heartbeat=5.0, max_msg_size=LONGEST)
        await socket.prepare(request)
        self._clients.add(socket)
        tasks = {asyncio.create_task(self._show(socket))}
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    answer = asyncio.create_task(self._answer(socket, message.data))
                    tasks.add(answer)
                    answer.add_done_callback(tasks.discard)
        finally:
            self._clients.discard(socket)
            for task in tasks:
                task.cancel()
        return socket

    async def _show(self, socket: web.WebSocketResponse) -> None:
        """Send pictures to a client; one that is slow to take them keeps no other waiting."""
        await _send(socket, {"steers": self._give is not None})
        offered = None
        while not socket.closed:
            if (offer := self._picture.offer) is not None and offer is not offered:
                offered = offer
                await _send(socket, {"offer": offer})
            await _send(socket, self._now())
            await asyncio.sleep(PERIOD_S)

    def _now(self) -> str:
        """Return the picture, one for all clients."""
        made, text = self._made
        if (now := time.monotonic()) - made >= PERIOD_S / 2:
            text = json.dumps({"picture": self._picture.snapshot()})
            self._made = now, text
        return text

    async def _answer(self, socket: web.WebSocketResponse, text: str) -> None:
        try:
            asked = json.loads(text)
            verb, name, value = (str(asked.get(key, "")) for key in ("verb", "name", "value"))
            number = asked.get("id")
        except (ValueError, AttributeError):
            return  # no page of ours
        answer = Answer("this page only shows the run")
        if self._give is not None:
            threads = self._stops if verb == "stop" else self._commands
            loop = asyncio.get_running_loop()
            answer = await loop.run_in_executor(threads, self._give, verb, name, value)
        await _send(socket, {"answer": {"id": number, **answer._asdict()}})

    async def _close(self, app: web.Application) -> None:
        del app
        for socket in list(self._clients):
            await socket.close()
        for threads in (self._commands, self._stops):
            threads.shutdown(wait=False, cancel_futures=True)


async def _send(socket: web.WebSocketResponse, message: dict[str, Any] | str) -> None:
    """Send, unless the client is leaving."""
    with suppress(ConnectionError, RuntimeError):
        await socket.send_str(message if isinstance(message, str) else json.dumps(message))
