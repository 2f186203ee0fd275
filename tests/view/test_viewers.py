import socket
import time
import urllib.error
import urllib.request

import pytest
import rerun as rr

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.view import viewers
from sumo_dist.view.outputs import LiveServer, Outputs
from sumo_dist.view.rrd_file import RrdFile
from sumo_dist.view.viewers import Viewer, free_port


def page(address):
    """Fetch a page, waiting for its server to come up."""
    for _ in range(50):
        try:
            with urllib.request.urlopen(address, timeout=2) as response:
                return response.read()
        except urllib.error.URLError:
            time.sleep(0.1)
    raise AssertionError(f"nobody answers at {address}")


def test_a_file_is_shown_in_the_browser_and_nothing_is_left_behind(tmp_path):
    with Outputs("test", RrdFile(tmp_path / "run.rrd", pytest.fail)) as out:
        out.log("seen", rr.Scalars(1.0), tick=0)
    with Viewer("web", tmp_path / "run.rrd") as viewer:
        assert viewer.address is not None
        assert b"<html" in page(viewer.address)
        assert viewer.running()
        port = int(viewer.address.split(":")[2].split("/")[0])
        with socket.socket() as probe, pytest.raises(OSError, match="refused"):
            probe.connect(("127.0.0.2", port))  # it listens on 127.0.0.1 alone
    assert not viewer.running()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(viewer.address, timeout=2)


def test_the_page_may_ask_this_machine_only_and_its_process_reports_to_nobody(
    tmp_path, monkeypatch
):
    started = []
    popen = viewers.subprocess.Popen
    monkeypatch.setattr(
        viewers.subprocess, "Popen", lambda *a, **k: started.append(k["env"]) or popen(*a, **k)
    )
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    with Outputs("test", RrdFile(tmp_path / "run.rrd", pytest.fail)) as out:
        out.log("seen", rr.Scalars(1.0), tick=0)
    with Viewer("web", tmp_path / "run.rrd") as viewer:
        page(viewer.address)
        with urllib.request.urlopen(viewer.address, timeout=10) as response:
            policy = response.headers["Content-Security-Policy"]
        root = viewer.address.partition("?")[0]
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{root}no-such-file", timeout=10)
    hosts = [word for word in policy.split() if "//" in word]
    assert hosts == ["http://127.0.0.1:*", "http://localhost:*"]
    assert "*" not in policy.split()
    assert (started[0]["CI"], started[0]["FORCE_RERUN_ANALYTICS"]) == ("true", "0")


def test_a_live_server_is_what_the_page_connects_to():
    with (
        LiveServer(free_port(9876)) as server,
        Outputs("test", url=server.url) as out,
        Viewer("web", server.url) as viewer,
    ):
        out.log("seen", rr.Scalars(1.0), tick=0)
        assert server.url.startswith("rerun+http://127.0.0.1:")
        assert viewer.address is not None
        port = server.url.split(":")[2].split("/")[0]
        assert f"?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port}%2Fproxy" in viewer.address
        assert b"<html" in page(viewer.address)


def test_a_server_outlives_the_episodes_that_are_sent_to_it(eventually):
    def answers():
        try:
            socket.create_connection((host, int(port)), timeout=5).close()
        except ConnectionRefusedError:
            return False
        return True

    with LiveServer(free_port(9876)) as server:
        host, port = server.url.split("//")[1].split("/")[0].split(":")
        for episode in ("one", "two"):
            with Outputs(episode, url=server.url) as out:
                out.log("seen", rr.Scalars(1.0), tick=0)
            assert answers()
    assert eventually(
        lambda: not answers()
    )  # Rerun closes the port after disconnect() has returned


def test_a_taken_port_is_avoided():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert free_port(port) != port


def test_a_window_needs_a_display(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(SumoError, match=r"no display.*--viewer web"):
        Viewer("native", "run.rrd")


def test_an_unknown_viewer_names_those_there_are():
    with pytest.raises(UsageError, match="native, none, web"):
        Viewer("holodeck", "run.rrd")
