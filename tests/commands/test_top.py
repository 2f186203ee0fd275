import json
import threading
import time
from contextlib import ExitStack
from dataclasses import replace

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


def test_many_workers_share_a_line_but_for_those_that_are_silent():
    counters = {"answered": 0, "refused": 0, "task": "spot/move_box", "busy s": 0.5}
    rows = [Row("robot", "running", 0.2, {"tick": 40})]
    for i in range(256):
        mode = "silent" if i in (3, 70) else "worker"
        age = 9.0 if mode == "silent" else i / 1000
        rows.append(Row(f"w-{i}", mode, age, {**counters, "answered": i}, worker=True))
    alive = [Member("worker", f"w-{i}", 2, "-") for i in range(256)]
    text = screen("spot", rows, [*alive, Member("robot", "main", 2, "-")])
    assert text.splitlines() == [
        "spot: robot main, 256 workers",
        "",
        "robot        running      0.2 s ago  tick 40",
        "254 workers  worker       0.3 s ago  answered 32567 (0 to 255 each), task spot/move_box, "
        "busy s 127.0 (0.5 to 0.5 each)",
        "w-3          silent       9.0 s ago  answered 3, task spot/move_box, busy s 0.5",
        "w-70         silent       9.0 s ago  answered 70, task spot/move_box, busy s 0.5",
    ]
    gone = [replace(row, mode="silent") for row in rows if row.worker]
    lines = screen("spot", gone, []).splitlines()
    assert len(lines) == 2 + top.FEW + 1
    assert lines[-1].startswith("248 more")


def test_256_workers_on_a_bus_are_shown_in_time(endpoint, capsys, monkeypatch, eventually):
    """Twice a second each says how it is, as workers do; a look takes a small part of its time."""
    took, lay_out = [], top.screen

    def timed(*args):
        began = time.process_time()
        text = lay_out(*args)
        took.append(time.process_time() - began)
        return text

    monkeypatch.setattr(top, "screen", timed)
    names = [f"w-{i}" for i in range(256)]
    with open_router(endpoint), Bus.dial(endpoint, POOL) as pool, ExitStack() as stack:
        stack.enter_context(Bus.dial(endpoint, "spot")).announce("robot", "main")
        for name in names:
            pool.announce("worker", name)
            counters = {"answered": 40, "refused": 0, "task": "spot/move_box"}
            beat = Heartbeat(pool, name, lambda counters=counters: ("worker", counters))
            stack.enter_context(beat)
        looks = []

        def all_are_shown():
            assert main(["top", "--connect", endpoint, "--times", "1"]) == 0
            looks.append(capsys.readouterr().out.splitlines())
            return any(line.startswith("256 workers  worker ") for line in looks[-1])

        assert eventually(all_are_shown, 60.0)
    assert looks[-1][0] == "spot: robot main, 256 workers"
    for said in looks:
        assert len(said) <= 3 + top.FEW
        assert max(map(len, said)) < 100
    assert max(took) < 0.1


@pytest.mark.parametrize(
    ("args", "message"),
    [(["--every", "0"], "every must be from 0.1"), (["--times", "0"], "times must be at least 1")],
)
def test_bad_options_are_one_line(args, message, capsys):
    assert main(["top", *args]) == 2
    assert message in capsys.readouterr().err
