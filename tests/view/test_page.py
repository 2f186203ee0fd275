"""The page's server passes on what there is, once it is there, and nothing else."""

import threading
import time
import urllib.error
import urllib.request
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from sumo_dist.view.page import POLICY, PageServer
from sumo_dist.view.viewers import free_port


class _Files(BaseHTTPRequestHandler):
    def do_GET(self):
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
            server.handle_request()
            server.handle_request()

    thread = threading.Thread(target=serve_late)
    thread.start()
    with PageServer(outer, f"http://127.0.0.1:{inner}"):
        root = f"http://127.0.0.1:{outer}"
        with urllib.request.urlopen(f"{root}/app.wasm?url=x", timeout=30) as response:
            assert response.read() == b"\0asm"
            assert response.headers["Content-Type"] == "application/wasm"
            assert response.headers["Content-Security-Policy"] == POLICY
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{root}/none", timeout=30)
    thread.join()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(f"{root}/app.wasm", timeout=2)
