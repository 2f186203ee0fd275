"""The page's server passes on what there is, once it is there, and nothing else."""

import threading
import time
import urllib.error
import urllib.request
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import ClassVar

import pytest

from sumo_dist.view.page import PAGE, POLICY, PROGRAM, SLOWLY_AND_STREAMED, PageServer
from sumo_dist.view.viewers import Viewer, free_port


class _Files(BaseHTTPRequestHandler):
    asked: ClassVar[list[str]] = []

    def do_GET(self):
        self.asked.append(self.path)
        if self.path != "/app.wasm":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "application/wasm")
        self.end_headers()
        self.wfile.write(b"\0asm")

    def log_message(self, *_):
        pass


def test_a_file_comes_with_a_policy_when_its_server_is_up():
    inner, outer = free_port(0), free_port(0)

    def serve_late():
        time.sleep(0.3)
        with HTTPServer(("127.0.0.1", inner), _Files) as server:
            for _ in range(3):  # the viewer's program is fetched unasked
                server.handle_request()

    thread = threading.Thread(target=serve_late)
    thread.start()
    with PageServer(outer, f"http://127.0.0.1:{inner}"):
        root = f"http://127.0.0.1:{outer}"
        with urllib.request.urlopen(f"{root}/app.wasm?url=x", timeout=30) as response:
            assert response.read() == b"\0asm"
            assert response.headers["Content-Type"] == "application/wasm"
            assert response.headers["Content-Security-Policy"] == POLICY
            tag = response.headers["ETag"]
        again = urllib.request.Request(f"{root}/app.wasm", headers={"If-None-Match": tag})
        with pytest.raises(urllib.error.HTTPError, match="304"):  # it is at hand in the browser
            urllib.request.urlopen(again, timeout=30)
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{root}/none", timeout=30)
    thread.join()
    assert sorted(_Files.asked) == sorted(["/app.wasm", "/none", PROGRAM])  # each once
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(f"{root}/app.wasm", timeout=2)


class _Cut(BaseHTTPRequestHandler):
    """Ends in the middle of each answer, as a viewer that is closed does."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Length", "1000")
        self.end_headers()
        self.wfile.write(b"half of it")

    def log_message(self, *_):
        pass


def test_a_viewer_that_ends_in_the_middle_of_an_answer_is_told_to_the_browser(recwarn):
    with HTTPServer(("127.0.0.1", 0), _Cut) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = free_port(0)
        with PageServer(port, f"http://127.0.0.1:{server.server_port}"):
            for path in (PROGRAM, "/other"):
                with pytest.raises(urllib.error.HTTPError, match="502"):
                    urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=30)
        server.shutdown()
    assert not recwarn.list  # of a thread that raised


def test_the_viewers_program_is_compiled_while_it_comes():
    """Rerun's page is still the one that this is about, and asks for it in the other way."""
    with Viewer("web", "rerun+http://127.0.0.1:9/proxy") as viewer:
        root = f"http://127.0.0.1:{viewer.port}"
        with urllib.request.urlopen(root + PAGE, timeout=30) as response:
            page = response.read()
        slowly, streamed = SLOWLY_AND_STREAMED
        assert page.count(streamed) == 1
        assert slowly not in page
        assert b"delete WebAssembly" not in page
        with urllib.request.urlopen(root + PROGRAM, timeout=30) as response:
            assert response.headers["Content-Type"] == "application/wasm"
            assert response.read(4) == b"\0asm"
