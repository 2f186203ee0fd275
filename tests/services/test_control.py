"""The operator's page against real services: what it shows and what its commands do."""

import asyncio
import json
import logging
import re
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import pytest
from aiohttp import ClientSession

from sumo_dist.cli import main
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.launch.launcher import Service
from sumo_dist.services import control
from sumo_dist.services.control import ControlOptions

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


class Seat:
    """A page's line to a control service."""

    def __init__(self, address):
        self._loop = asyncio.new_event_loop()
        self._session = self._do(self._opened())
        self._socket = self._do(self._session.ws_connect(address + "live"))
        self.offers, self.answers, self.picture = [], {}, None
        self._number = 0

    async def _opened(self):
        return ClientSession()

    def _do(self, coroutine):
        return self._loop.run_until_complete(asyncio.wait_for(coroutine, 30))

    def _take(self):
        message = json.loads(self._do(self._socket.receive_str()))
        self.picture = message.get("picture", self.picture)
        if "offer" in message:
            self.offers.append(message["offer"])
        if "answer" in message:
            self.answers[message["answer"]["id"]] = message["answer"]["refusal"]

    def give(self, verb, name="", value=""):
        """Return why a command is refused."""
        self._number += 1
        command = {"id": self._number, "verb": verb, "name": name, "value": value}
        self._do(self._socket.send_str(json.dumps(command)))
        while self._number not in self.answers:
            self._take()
        return self.answers.pop(self._number)

    def until(self, condition, timeout=60.0):
        """Wait for a picture."""
        deadline = time.monotonic() + timeout
        while self.picture is None or not condition(self.picture):
            assert time.monotonic() < deadline, self.picture
            self._take()
        return self.picture

    def close(self):
        self._do(self._socket.close())
        self._do(self._session.close())
        self._loop.close()


@contextmanager
def seat(endpoint, caplog, **changes):
    """A control service of a robot's bus, and a page's line to it."""
    stop = threading.Event()
    options = ControlOptions(connect=endpoint, robot="spot", listen="127.0.0.1:0", **changes)
    with caplog.at_level(logging.INFO, "sumo_dist.control"):
        caplog.clear()
        thread = threading.Thread(target=control.run, args=(options, stop))
        thread.start()
        deadline = time.monotonic() + 60
        while not (found := re.search(r"run at (http\S+)", caplog.text)):
            assert time.monotonic() < deadline
            assert thread.is_alive()
            time.sleep(0.05)
    line = Seat(found[1])
    try:
        yield line
    finally:
        line.close()
        stop.set()
        thread.join(30)
        assert not thread.is_alive()


def test_an_episode_is_steered_and_repeats_and_the_next_one_is_offered(
    robot_starts, caplog, assert_repeats
):
    """Pause, step, a weight, a goal, an optimizer, a drained worker, another task, a stop."""
    system = robot_starts(time_limit=3600.0, stay=True)
    system.after_plan(1)
    with seat(system.endpoint, caplog) as page:
        assert page.give("pause") == ""
        page.until(lambda p: p["robot"]["mode"] == "paused" and p["numbers"] and p["floor"])
        offer = page.offers[-1]
        assert (offer["task"], offer["clock"]) == ("spot/move_box", "lockstep")
        first = page.picture["plan"]["number"]

        assert page.give("weight", "goal", "77") == ""
        assert page.give("parameter", "goal", "1.5,-0.5") == ""
        assert page.give("planner", "optimizer", "cem") == ""
        assert page.give("planner", "nodes", "7").startswith("nodes cannot change")
        assert page.give("weight", "nose", "1").startswith("unknown cost term 'nose'; valid:")
        assert page.give("dance") == "there is no command 'dance'"
        assert page.give("drain", "local-7").startswith("unknown worker")
        assert page.give("drain", "local-1") == ""
        page.until(lambda p: [w["alive"] for w in p["workers"] if w["name"] == "local-1"] != [True])

        assert page.give("step", value="10") == ""
        page.until(lambda p: p["plan"]["number"] >= first + 3 and p["robot"]["mode"] == "paused")
        numbers = page.until(lambda p: p["numbers"]["settings"]["optimizer"] == "cem")["numbers"]
        assert numbers["weights"][offer["terms"].index("goal")] == 77.0
        assert numbers["parameters"][:2] == [1.5, -0.5]

        assert page.give("task", "spot/move_tire", "4") == ""
        page.until(lambda p: page.offers[-1]["task"] == "spot/move_tire" and p["plan"])
        assert page.offers[-1]["seed"] == 4
        assert page.give("stop", value="enough") == ""
        end = page.until(lambda p: p["end"])["end"]
        assert end["reason"].startswith("stopped by ")
        assert page.give("reset", value="5") == ""
        page.until(lambda p: page.offers[-1]["seed"] == 5 and p["robot"]["mode"] == "running")
        assert page.give("stop") == ""
        page.until(lambda p: p["end"])
    told = system.recording(1).operator
    assert [c["verb"] for c in told] == ["pause", "weight", "parameter", "planner", "step", "task"]
    assert_repeats(system.recording(1))
    assert system.processes["local-1"].wait(10) == 0


def test_it_only_shows_when_told_so_and_outlives_the_robot(robot_starts, caplog):
    system = robot_starts(time_limit=3600.0)
    with seat(system.endpoint, caplog, watch=True) as page:
        page.until(lambda p: p["plan"])
        assert page.give("stop") == "this page only shows the run"
        system.interrupt()
        page.until(lambda p: p["end"] and "robot" not in p["services"])
        assert page.picture["end"]["reason"] == "interrupted"


@pytest.mark.parametrize(
    ("listen", "said"),
    [
        ("7480", "listen must be ADDRESS:PORT"),
        ("127.0.0.1:70000", "listen must be ADDRESS:PORT"),
        ("127.0.0.1:x", "listen must be ADDRESS:PORT"),
        ("192.0.2.1:7480", "cannot listen on 192.0.2.1:7480"),
    ],
)
def test_an_address_that_cannot_be_listened_on_is_named(listen, said):
    with pytest.raises(SumoError, match=re.escape(said)):
        control.listening(listen)


def test_where_the_port_is_taken_any_other_is_used_but_not_for_one_that_was_asked_for():
    with control.listening(None) as first, control.listening(None) as second:
        assert first.getsockname()[1] != second.getsockname()[1]
        port = second.getsockname()[1]
        with pytest.raises(SumoError, match=rf"cannot listen on 127.0.0.1:{port}: "):
            control.listening(f"127.0.0.1:{port}")


def test_beyond_this_machine_there_is_a_token_and_a_warning(paused, caplog):
    stop = threading.Event()
    options = ControlOptions(connect=paused.endpoint, robot="spot", listen="0.0.0.0:0")
    with caplog.at_level(logging.INFO, "sumo_dist.control"):
        thread = threading.Thread(target=control.run, args=(options, stop))
        thread.start()
        deadline = time.monotonic() + 60
        while "without https" not in caplog.text and time.monotonic() < deadline:
            time.sleep(0.05)
        stop.set()
        thread.join(30)
    assert re.search(r"steer the run at http://\S+:\d+/\?token=\S{20,}", caplog.text)
    assert "its token can be read there" in caplog.text


def test_a_folder_without_a_certificate_is_named(tmp_path):
    with pytest.raises(UsageError, match=r"has no cert\.pem and key\.pem that fit"):
        control._tls(tmp_path)


def test_without_a_robot_it_says_so(free_endpoint, capsys):
    assert main(["control", "--connect", free_endpoint()]) == 3
    assert "no robot is there: no router answers" in capsys.readouterr().err


def test_ctl_drains_a_worker(paused, capsys):
    options = replace(paused.options("local-0"), name="spare")
    paused.start(Service("spare", "rollout-worker", options, vital=False))
    deadline = time.monotonic() + 60
    words = ["ctl", "drain", "spare", "--connect", paused.endpoint, "--robot", "spot"]
    while main(words) != 0:
        assert "unknown worker 'spare'; valid: local-0" in capsys.readouterr().err
        assert time.monotonic() < deadline
    assert "spare is not at" in capsys.readouterr().out
    assert paused.processes["spare"].wait(10) == 0
    assert main([*words[:2], *words[3:]]) == 2
    assert "needs `ctl drain WORKER`, got nothing" in capsys.readouterr().err
