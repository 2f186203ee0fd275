"""The viewer's page, served so that the browser asks nobody on the internet.

Rerun's page asks for a font, which it waits for, and for the newest release, and sends statistics
of its use. It has no switch for that, but browsers obey a policy that comes with a page.
"""

import hashlib
import threading
import urllib.error
import urllib.request
from contextlib import suppress
from dataclasses import dataclass
from http.client import HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

HERE = "http://127.0.0.1:* http://localhost:*"  # any port: a tunnel's end may have another
POLICY = f"default-src 'self' {HERE} data: blob: 'unsafe-inline' 'wasm-unsafe-eval'"

PAGE, PROGRAM = "/", "/re_viewer_bg.wasm"
# Rerun's page compiles its program when all of it has come. Browsers can while it comes, and keep
# what they have compiled, if they may fetch it themselves. Another release's page stays as it is.
SLOWLY_AND_STREAMED = (
    b"        wasm_with_progress();\n",
    b"""        wasm_bindgen("./re_viewer_bg.wasm")
          .then(() => (clearTimeout(timeoutId), on_wasm_loaded()))
          .catch(on_wasm_error);
""",
)

WITHOUT_STREAMS = b"delete WebAssembly.instantiateStreaming;"

_START_S = 10.0  # how long Rerun's own server may take to come up
_RETRY_S = 0.05


class PageServer:
    """Passes on what Rerun's web server has, on 127.0.0.1, and a policy; a context manager.

    The viewer's program, WASM, is fetched before anybody asks for it: Rerun's server unpacks its
    43 MB anew for each request. A browser that has it already is told so.
    """

    def __init__(self, port: int, origin: str) -> None:
        """Serve on a port what there is at an origin, such as http://127.0.0.1:9090."""
        shelf = _Shelf(origin)
        handler = type("Handler", (_Handler,), {"shelf": shelf})
        self._server = ThreadingHTTPServer(("127.0.0.1", port), handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()
        threading.Thread(target=shelf.warm, daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@dataclass(frozen=True)
class _File:
    body: bytes
    kind: str
    tag: str  # changes with the body


class _Shelf:
    """Files of an origin, each fetched once. May be asked by any thread."""

    def __init__(self, origin: str) -> None:
        self._origin = origin
        self._files: dict[str, _File] = {}
        self._lock = threading.Lock()

    def get(self, path: str) -> _File:
        """Return a file; a server that is not up yet is waited for.

        Raises:
            OSError: it has no such file, an HTTPError, or does not answer.
        """
        with self._lock:  # two browsers must not make Rerun unpack the same file twice
            if path not in self._files:
                try:
                    with _open(self._origin + path) as found:
                        body, kind = found.read(), found.headers.get_content_type()
                except HTTPException as error:  # it ended in the middle of an answer
                    raise ConnectionError(str(error)) from None
                if path == PAGE and SLOWLY_AND_STREAMED[0] in body:
                    body = body.replace(*SLOWLY_AND_STREAMED).replace(WITHOUT_STREAMS, b"")
                tag = f'"{hashlib.blake2b(body, digest_size=12).hexdigest()}"'
                self._files[path] = _File(body, kind, tag)
            return self._files[path]

    def warm(self) -> None:
        """Fetch what every browser asks for."""
        with suppress(OSError):  # who asks for it will be told
            self.get(PROGRAM)


class _Handler(BaseHTTPRequestHandler):
    shelf: _Shelf

    def do_GET(self) -> None:
        """Answer with the origin's file, or say that the browser has it already."""
        try:
            found = self.shelf.get(self.path.partition("?")[0])
        except urllib.error.HTTPError as error:
            self._answer(error.code)
        except OSError:
            self._answer(502)  # Rerun's viewer does not answer
        else:
            known = self.headers.get("If-None-Match") == found.tag
            self._answer(304 if known else 200, b"" if known else found.body, found.kind, found.tag)

    def _answer(
        self, code: int, body: bytes = b"", kind: str = "text/plain", tag: str = ""
    ) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Security-Policy", POLICY)
        if tag:
            self.send_header("ETag", tag)
            self.send_header("Cache-Control", "no-cache")  # may be kept, is asked for each time
        self.end_headers()
        self.wfile.write(body)

    def log_request(self, code: Any = "-", size: Any = "-") -> None:
        """Say nothing: requests are not news."""


def _open(address: str) -> Any:
    pause = threading.Event()
    for _ in range(round(_START_S / _RETRY_S)):
        try:
            return urllib.request.urlopen(address, timeout=_START_S)
        except urllib.error.HTTPError:
            raise
        except urllib.error.URLError:
            pause.wait(_RETRY_S)
    raise ConnectionRefusedError(address)
