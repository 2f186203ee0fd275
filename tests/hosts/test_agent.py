"""A host's agent by its standard input and output, as a launcher has it."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from sumo_dist.hosts.installation import Installation
from sumo_dist.hosts.protocol import SILENCE_S
from sumo_dist.wire.session import nobody_listens

START_S = 60.0  # a process on a busy machine


class Agent:
    """An agent in a process of its own; the test is its launcher."""

    def __init__(self, folder, host="here"):
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "sumo_dist", "host-agent", "--host", host],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=folder,
        )
        self.events = []

    def say(self, **message):
        with suppress(BrokenPipeError):  # it ends
            self.process.stdin.write(json.dumps(message).encode() + b"\n")
            self.process.stdin.flush()

    def start(self, name, *words, listens=""):
        command, *words = words
        self.say(start=[{"name": name, "command": command, "words": words, "listens": listens}])

    def until(self, event, **also):
        """Return the next such event, speaking to the agent meanwhile."""
        while line := self.process.stdout.readline():
            said = json.loads(line)
            self.events.append(said)
            if said["event"] == event and also.items() <= said.items():
                return said
            if said["event"] == "alive":
                self.say(alive=True)
        raise AssertionError(f"the agent has ended before {event}: {self.events}")


@pytest.fixture
def agent(tmp_path):
    begun = []

    def agent(**options):
        begun.append(Agent(tmp_path, **options))
        return begun[-1]

    yield agent
    for one in begun:
        one.process.kill()
        one.process.wait()
        one.process.stdout.close()


@pytest.fixture
def serving(agent, endpoint):
    """Start an agent with a router that listens."""
    one = agent()
    assert one.until("hello")["installation"] == Installation.here().to_json()
    one.start("router", "router", "--listen", endpoint, listens=endpoint)
    one.until("ready", service="router")
    assert not nobody_listens(endpoint)
    return one


def test_services_are_started_heard_and_stopped(serving, endpoint, tmp_path):
    serving.start("wrong", "rollout-worker", "--threads", "0")
    said = serving.until("log", service="wrong")
    assert "threads must be from 1 to 256" in said["text"]
    assert serving.until("ended", service="wrong")["code"] == 2
    logged = [said["text"] for said in serving.events if said["event"] == "log"]
    assert any(f"router listening on {endpoint}" in text for text in logged)
    serving.say(stop=True)
    assert serving.until("ended", service="router")["code"] == 0
    serving.until("stopped")
    assert serving.process.wait(START_S) == 0
    assert nobody_listens(endpoint)
    assert list((tmp_path / "agents").iterdir()) == []


def test_a_launcher_that_is_gone_ends_the_services(serving, endpoint):
    serving.process.stdin.close()
    assert serving.process.wait(START_S) == 0
    assert nobody_listens(endpoint)


def test_a_launcher_that_is_silent_ends_the_services(serving, endpoint):
    """As when a link is cut, or the launcher's host is: nothing closes the stream."""
    began = time.monotonic()
    serving.process.stdout.close()  # nobody reads, either
    serving.process.wait(START_S)
    assert time.monotonic() - began > SILENCE_S - 2.0
    assert nobody_listens(endpoint)


def test_a_frozen_agents_services_end_when_it_is_killed(serving, endpoint, eventually):
    serving.process.send_signal(signal.SIGSTOP)
    serving.process.kill()
    serving.process.wait()
    assert eventually(lambda: nobody_listens(endpoint), START_S)


def test_nonsense_is_no_launcher(serving, endpoint):
    serving.process.stdin.write(b"\xff\x00{]\n")
    serving.process.stdin.flush()
    serving.until("stopped")
    assert nobody_listens(endpoint)


def test_a_second_agent_of_a_run_waits_for_the_first(serving, agent):
    second = agent()
    os.set_blocking(second.process.stdout.fileno(), False)
    deadline = time.monotonic() + 3.0
    while time.monotonic() < deadline:
        assert second.process.stdout.read() is None, "it did not wait"
        serving.say(alive=True)
        time.sleep(0.1)
    os.set_blocking(second.process.stdout.fileno(), True)
    serving.say(stop=True)
    second.until("hello")


def test_what_is_installed_is_said(tmp_path):
    done = subprocess.run(
        [sys.executable, "-P", "-m", "sumo_dist", "host-agent", "--identity"],
        capture_output=True,
        cwd=tmp_path,
        check=True,
        timeout=START_S,
    )
    assert Installation.from_json(done.stdout) == Installation.here()
    assert list(tmp_path.iterdir()) == []
