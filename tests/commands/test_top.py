import json
import threading
import time

import pytest

from sumo_dist.cli import main
from sumo_dist.commands import top
from sumo_dist.commands.top import Board, Row, look, screen
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.health import Heartbeat
from sumo_dist.wire.keys import POOL, Member
from sumo_dist.wire.notices import Health
from sumo_dist.wire.session import open_router


def test_a_service_that_says_nothing_any_more_is_silent(monkeypatch):
    board = Board()
    board.take(Health("run", "robot", "running", {"tick": 7}))
    assert board.rows() == [Row("robot", "running", 0.0, {"tick": 7})]
    monkeypatch.setattr(top, "STALE_S", 0.0)
    assert board.rows()[0].mode == "silent"


def test_the_screen_has_a_line_a_service_and_leaves_out_zeros():
    rows = [Row("optimizer", "realtime", 0.2, {"plan": 40, "lost": 0})]
    text = screen("spot", rows, [Member("worker", "local-0", 2, "-")])
    assert text.splitlines() == [
        "spot: worker local-0",
        "",
        "optimizer  realtime     0.2 s ago  plan 40",
    ]
    assert look(rows, [])["services"]["optimizer"]["lost"] == 0


def test_a_pulse_is_seen_with_what_its_bus_has_dropped(endpoint, capsys):
    with open_router(endpoint), Bus.dial(endpoint, "spot", run="r") as bus:
        bus.rejected["checksum"] += 3
        with Heartbeat(bus, "robot", lambda: ("stopped", {"sent": 12})):
            bus.announce("robot", "main")
            assert main(["top", "--connect", endpoint, "--times", "2", "--json"]) == 0
    seen = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert seen["alive"] == ["robot main"]
    robot = seen["services"]["robot"]
    assert (robot["mode"], robot["sent"], robot["dropped checksum"]) == ("stopped", 12, 3)


def test_a_pulse_ends_with_its_service(endpoint):
    with open_router(endpoint), Bus.dial(endpoint, "spot") as bus:
        with Heartbeat(bus, "robot", lambda: ("running", {})):
            time.sleep(0.1)
        assert not [t for t in threading.enumerate() if "_beat" in t.name]


def test_a_worker_is_there_from_its_token_on(endpoint, capsys):
    asked = ["top", "--connect", endpoint, "--worker", "w-1"]
    with open_router(endpoint):
        assert main(asked) == 1
        with Bus.dial(endpoint, POOL) as bus:
            bus.announce("worker", "w-2")
            assert main(asked) == 1
            bus.announce("worker", "w-1")
            assert main(asked) == 0
        assert main(asked) == 1
    there, gone = f"worker w-1 is at {endpoint}", f"worker w-1 is not at {endpoint}"
    assert capsys.readouterr().out.splitlines() == [gone, gone, there, gone]


@pytest.mark.parametrize(
    ("args", "message"),
    [(["--every", "0"], "every must be from 0.1"), (["--times", "0"], "times must be at least 1")],
)
def test_bad_options_are_one_line(args, message, capsys):
    assert main(["top", *args]) == 2
    assert message in capsys.readouterr().err
