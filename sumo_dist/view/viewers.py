"""Opening Rerun's viewer, in the browser or as a window, on a live server or a file."""

import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Self
from urllib.parse import quote

import rerun_cli

from sumo_dist.errors import SumoError, unknown
from sumo_dist.view.page import PageServer

VIEWERS = ("web", "native", "none")
SERVER_PORT, WEB_PORT = 9876, 9090  # Rerun's own defaults

_STOP_S = 2.0


class Viewer:
    """A viewer in a process of its own; closing it ends that process.

    It is Rerun's binary itself: the `rerun` script that pip installs would leave the binary running
    when it is ended. It listens on loopback only, which `rerun.serve_web_viewer` does not.
    """

    def __init__(self, kind: str, source: str | Path) -> None:
        """Open a viewer.

        Args:
            kind: one of VIEWERS; "none" opens nothing.
            source: url of a server, or path of an .rrd.

        Raises:
            SumoError: there is no such kind, no display for a window, or no viewer installed.
        """
        self.address: str | None = None  # of the page to open, for "web"
        self.port: int | None = None  # that it is served on
        self._process: subprocess.Popen[bytes] | None = None
        self._page: PageServer | None = None
        if kind not in VIEWERS:
            raise unknown("viewer", kind, VIEWERS)
        if kind == "native" and not _has_display():
            raise SumoError("there is no display for the native viewer; try --viewer web")
        if kind == "web":
            self._serve_web(source)
        elif kind == "native":
            self._process = _start("--bind", "127.0.0.1", "--port", "auto", str(source))

    @property
    def opened(self) -> bool:
        """Whether there was anything to open."""
        return self._process is not None

    def running(self) -> bool:
        """Whether there is a viewer and its process has not ended."""
        return self._process is not None and self._process.poll() is None

    def wait(self) -> None:
        """Return when the viewer has ended; at once if there is none."""
        if self._process is not None:
            self._process.wait()

    def close(self) -> None:
        """End the viewer."""
        if self._page is not None:
            self._page.close()
            self._page = None
        if self._process is None:
            return
        self._process.terminate()  # of one that has ended, nothing

        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _serve_web(self, source: str | Path) -> None:
        web, inner, server = free_port(WEB_PORT), free_port(0), free_port(SERVER_PORT)
        ports = ("--web-viewer-port", str(inner), "--port", str(server))
        self._process = _start("--serve-web", "--bind", "127.0.0.1", *ports, str(source))
        # A file is served by the viewer's process itself.
        live = source if isinstance(source, str) else f"rerun+http://127.0.0.1:{server}/proxy"
        self._page = PageServer(web, f"http://127.0.0.1:{inner}")
        page = f"http://127.0.0.1:{web}/"
        self.port = web
        self.address = f"{page}?url={quote(live, safe='')}&hide_welcome_screen"


def free_port(preferred: int) -> int:
    """Return a port of 127.0.0.1 that nobody listens on: the preferred one, or else any."""
    for port in (preferred, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return probe.getsockname()[1]
    raise SumoError("no free port on 127.0.0.1")


def _start(*arguments: str) -> subprocess.Popen[bytes]:
    binary = Path(rerun_cli.__file__).with_name("rerun.exe" if os.name == "nt" else "rerun")
    try:
        return subprocess.Popen(
            [str(binary), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=_environment(),
        )
    except OSError as error:
        raise SumoError(f"the Rerun viewer does not start: {error}") from None


def _environment() -> dict[str, str]:
    """Variables for Rerun under which it sends no statistics of its use.

    Its own switch, `rerun analytics disable`, is a file of the user's. On a build machine, which it
    knows by CI, it sends none either.
    """
    return {**os.environ, "CI": "true", "FORCE_RERUN_ANALYTICS": "0"}


def _has_display() -> bool:
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
