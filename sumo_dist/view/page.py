"""The viewer's page, served so that the browser asks nobody on the internet.

Rerun's page asks for a font, which it waits for, and for the newest release, and sends statistics
of its use. It has no switch for that, but browsers obey a policy that comes with a page.
"""

import threading
import urllib.error
import urllib.request
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

HERE = "http://127.0.0.1:* http://localhost:*"  # any port: a tunnel's end may have another
POLICY = f"default-src 'self' {HERE} data: blob: 'unsafe-inline' 'wasm-unsafe-eval'"

_START_S = 10.0  # how long Rerun's own server may take to come up
_RETRY_S = 0.05


class PageServer:
    """Passes on what Rerun's web server has, on 127.0.0.1, and a policy; a context manager."""

    def __init__(self, port: int, origin: str) -> None:
        """Serve on a port what there is at an origin, such as http://127.0.0.1:9090."""
        handler = type("Handler", (_Handler,), {"origin": origin})
        self._server = ThreadingHTTPServer(("127.0.0.1", port), handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Handler(BaseHTTPRequestHandler):
    origin: str

    def do_GET(self) -> None:
        """Answer with the origin's file; a server that is not up yet is waited for."""
        try:
            with _open(self.origin + self.path.partition("?")[0]) as found:
                body, kind = found.read(), found.headers.get_content_type()
        except urllib.error.HTTPError as error:
            self._answer(error.code)
        except OSError:
            self._answer(502)  # Rerun's viewer does not answer
        else:
            self._answer(200, body, kind)

    def _answer(self, code: int, body: bytes = b"", kind: str = "text/plain") -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Security-Policy", POLICY)
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
