"""Rerun's page and data under the control page's own address: one port for a tunnel or a tablet."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable

from aiohttp import ClientConnectionError, ClientConnectorError, ClientSession, ClientTimeout, web

VIEW = "/view/"
_DATA = "/rerun.{call:.+}"  # calls of gRPC: /rerun.sdk_comms.v1alpha1.MessageProxyService/...
GAP_S = 10.0  # a tracer that is gone for less may be held up; as long as the page keeps its view
_AGAIN_S = 0.1
_PIECE = 1 << 16
_KEPT = ("Content-Type", "Cache-Control", "ETag", "Content-Encoding", "Content-Security-Policy")
_ASKED = (
    "Content-Type",
    "Accept",
    "If-None-Match",
    "X-Grpc-Web",
    "X-User-Agent",
    "Accept-Encoding",
)

Ports = tuple[int, int]
"""(of Rerun's page, of its data)"""


class RerunProxy:
    """Passes requests on to Rerun's servers of this machine, and the answers as they come.

    Rerun's page asks for its data once: whoever is not there yet, or for a moment, is waited for.
    """

    def __init__(self, ports: Callable[[], Ports | None]) -> None:
        """Pass on to wherever `ports` says that the tracer serves, if it does."""
        self._ports = ports
        self._session: ClientSession | None = None

    def add_to(self, app: web.Application) -> None:
        """Add the routes."""
        app.router.add_get(VIEW + "{path:.*}", self._page)
        app.router.add_route("*", _DATA, self._data)
        app.cleanup_ctx.append(self._open)

    async def _open(self, app: web.Application) -> AsyncIterator[None]:
        del app
        timeout = ClientTimeout(total=None, sock_connect=5.0)
        async with ClientSession(timeout=timeout, auto_decompress=False) as self._session:
            yield

    async def _page(self, request: web.Request) -> web.StreamResponse:
        return await self._pass_on(request, 0, f"/{request.match_info['path']}")

    async def _data(self, request: web.Request) -> web.StreamResponse:
        return await self._pass_on(request, 1, request.path)

    async def _pass_on(self, request: web.Request, which: int, path: str) -> web.StreamResponse:
        silent = web.Response(status=502, text="the tracer's viewer does not answer\n")
        deadline = time.monotonic() + GAP_S
        while True:
            ports = self._ports()
            try:
                if ports is not None:
                    return await self._fetch(request, f"http://127.0.0.1:{ports[which]}{path}")
            except ClientConnectorError:  # it does not listen
                pass
            except ClientConnectionError:  # it has ended meanwhile
                return silent
            if time.monotonic() > deadline:
                break
            await asyncio.sleep(_AGAIN_S)
        if ports is None:
            return web.Response(status=503, text="no tracer of this machine shows this session\n")
        return silent

    async def _fetch(self, request: web.Request, address: str) -> web.StreamResponse:
        assert self._session is not None, "there are no requests before the application has begun"
        asked = {name: request.headers[name] for name in _ASKED if name in request.headers}
        body = await request.read() or None
        async with self._session.request(
            request.method, address, headers=asked, data=body
        ) as found:
            kept = {name: found.headers[name] for name in _KEPT if name in found.headers}
            response = web.StreamResponse(status=found.status, headers=kept)
            await response.prepare(request)
            async for piece in found.content.iter_chunked(_PIECE):
                await response.write(piece)
            await response.write_eof()
            return response
