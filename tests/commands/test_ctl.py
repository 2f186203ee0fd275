"""Commands from a terminal: what they say, and what comes back."""

import threading
from contextlib import ExitStack, contextmanager
from typing import get_args

import pytest

from sumo_dist.cli import main
from sumo_dist.commands import ctl
from sumo_dist.dispatch import commander
from sumo_dist.dispatch.operator import BusOperator
from sumo_dist.episode.command import Verb
from sumo_dist.wire import finding, routers
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.routers import LocalRouter, left_note
from sumo_dist.wire.session import open_router


@contextmanager
def listening(router, robot, refusal=""):
    """A robot that answers every command at tick 40, the first time it looks at it."""
    with Bus.dial(router, robot, run="r") as bus:
        done, came, heard = threading.Event(), threading.Event(), []
        operator = BusOperator(bus, done, came.set)

        def answer():
            while not done.wait(0.02):
                for command in operator.take(40, 0.0):
                    heard.append(command)
                    operator.answer(command, 40, refusal)

        thread = threading.Thread(target=answer)
        thread.start()
        try:
            yield heard
        finally:
            done.set()
            thread.join()


@pytest.mark.parametrize(
    ("words", "verb", "name", "value"),
    [
        (["ctl", "pause"], "pause", "", ""),
        (["ctl", "resume"], "resume", "", ""),
        (["ctl", "step"], "step", "", ""),
        (["ctl", "step", "50"], "step", "", "50"),
        (["ctl", "reset"], "reset", "", ""),
        (["ctl", "reset", "7"], "reset", "", "7"),
        (["ctl", "task", "spot/move_cone"], "task", "spot/move_cone", ""),
        (["ctl", "task", "spot/move_cone", "7"], "task", "spot/move_cone", "7"),
        (["ctl", "weight", "goal=80"], "weight", "goal", "80"),
        (["ctl", "weight", "goal=-0.5"], "weight", "goal", "-0.5"),
        (["ctl", "parameter", "goal=1,-2"], "parameter", "goal", "1,-2"),
        (["ctl", "planner", "rollouts=64"], "planner", "rollouts", "64"),
        (["ctl", "stop", "a", "dog"], "stop", "", "a dog"),
        (["ctl", "stop"], "stop", "", ""),
        (["ctl", "stand"], "stand", "", ""),
        (["stop", "--reason", "a dog"], "stop", "", "a dog"),
        (["stop"], "stop", "", ""),
        (["resume"], "stand", "", ""),
    ],
)
def test_words_become_a_command_and_the_answer_a_line(router, robot, words, verb, name, value):
    with listening(router, robot) as heard:
        assert main([*words, "--connect", router, "--robot", robot]) == 0
    (command,) = heard
    assert (command.verb, command.name, command.value) == (verb, name, value)


def test_the_line_says_when_it_was_done(router, robot, capsys):
    with listening(router, robot):
        assert main(["ctl", "weight", "goal=80", "--connect", router, "--robot", robot]) == 0
    assert capsys.readouterr().out == f"{robot}: weight at tick 40\n"


def test_a_refusal_is_one_line_and_a_fault(router, robot, capsys):
    with listening(router, robot, "pause first"):
        assert main(["ctl", "step", "--connect", router, "--robot", robot]) == 3
    err = capsys.readouterr().err
    assert err == f"sumo-dist: {robot} refuses to step: pause first\n"


@contextmanager
def machine(monkeypatch, tmp_path, *runs):
    """Runs on this machine, (endpoint of their router, what they do), and no others."""
    monkeypatch.setenv(routers.VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setattr(finding, "DEFAULT_ENDPOINT", runs[0][0] if runs else "tcp/127.0.0.1:1")
    with ExitStack() as stack:
        for endpoint, what in runs:
            stack.enter_context(left_note(LocalRouter(endpoint, what, 7)))
        yield


def test_stop_finds_the_robot_whatever_its_name(router, robot, capsys, monkeypatch, tmp_path):
    with (
        machine(monkeypatch, tmp_path, (router, "run A")),
        listening(router, robot) as heard,
        Bus.dial(router, robot) as bus,
    ):
        bus.announce("robot", "main")
        assert main(["stop", "--robot", robot, "--reason", "a dog"]) == 0
    assert [(command.verb, command.value) for command in heard] == [("stop", "a dog")]
    assert capsys.readouterr().out == f"{robot} (run A): stop at tick 40\n"


def test_stop_stops_all_that_are_there_and_says_who_did_not_answer(
    endpoint, robot, capsys, monkeypatch, tmp_path, free_endpoint
):
    monkeypatch.setattr(commander, "PATIENCE_S", 1.0)
    hanging = free_endpoint()
    runs = machine(monkeypatch, tmp_path, (endpoint, "run A"), (hanging, "run B"))
    with runs, open_router(endpoint), ExitStack() as stack:
        heard = [stack.enter_context(listening(endpoint, name)) for name in ("spot", "g1")]
        for name in ("spot", "g1", "deaf"):
            bus = stack.enter_context(Bus.dial(endpoint, name))
            bus.announce("robot", "main")
        assert main(["stop"]) == 3
        assert [[command.verb for command in each] for each in heard] == [["stop"], ["stop"]]
        out, err = capsys.readouterr()
        assert sorted(out.splitlines()) == [
            f"{name} (run A): stop at tick 40" for name in ("g1", "spot")
        ]
        first, second = err.splitlines()
        assert "deaf (run A) did not answer within 1 s" in first
        assert f"the router at {hanging} (run B, process 7) does not answer: what runs" in second
        assert main(["resume"]) == 2
        assert "3 robots are here, choose one: --robot deaf for" in capsys.readouterr().err
        assert main(["resume", "--robot", "g1"]) == 0
        assert [command.verb for command in heard[1]] == ["stop", "stand"]


def test_stop_waits_for_a_robot_that_is_starting(endpoint, monkeypatch, tmp_path):
    with machine(monkeypatch, tmp_path, (endpoint, "run A")), ExitStack() as stack:
        stack.enter_context(open_router(endpoint))
        robot = stack.enter_context(Bus.dial(endpoint, "spot"))
        come = threading.Timer(0.5, lambda: robot.announce("robot", "main"))
        monkeypatch.setattr(ctl, "STARTING_S", 60.0)
        with listening(endpoint, "spot") as heard:
            come.start()
            assert main(["stop"]) == 0
        come.join()
    assert [command.verb for command in heard] == ["stop"]


@pytest.mark.parametrize("words", [["stop"], ["resume"], ["ctl", "pause"], ["top"]])
def test_without_any_run_it_says_so_at_once(words, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(ctl, "STARTING_S", 3600.0)
    with machine(monkeypatch, tmp_path):
        assert main(words) == 3
    err = capsys.readouterr().err
    assert err.startswith("sumo-dist: no robot is here: this user has no run with workers on this")
    assert err.count("\n") == 1


def test_without_the_router_that_is_named_it_says_so_at_once(capsys):
    for words in (["stop"], ["stop", "--robot", "g1"], ["ctl", "pause", "--robot", "spot"]):
        assert main([*words, "--connect", "tcp/127.0.0.1:9"]) == 3
        err = capsys.readouterr().err
        assert "no router answers" in err
        assert err.count("\n") == 1


def test_two_terminals_are_two_senders(router, robot):
    with listening(router, robot) as heard:
        for _ in range(2):
            assert main(["ctl", "pause", "--connect", router, "--robot", robot]) == 0
    assert len(heard) == 2
    assert heard[0].sender != heard[1].sender


def test_without_a_robot_it_gives_up_and_says_so(router, robot, capsys, monkeypatch):
    monkeypatch.setattr(commander, "PATIENCE_S", 0.3)
    assert main(["ctl", "pause", "--connect", router, "--robot", robot]) == 3
    err = capsys.readouterr().err
    assert f"{robot} did not answer within 0.3 s: it is not at {router}" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "unknown command ''; valid: drain, parameter, pause"),
        (["fly"], "unknown command 'fly'; valid: drain, parameter, pause, planner, reset"),
        (["pause", "now"], "needs `ctl pause`, got now"),
        (["step", "1", "2"], "needs `ctl step [TICKS]`, got 1 2"),
        (["task"], "needs `ctl task TASK [SEED]`, got nothing"),
        (["weight"], "needs `ctl weight NAME=VALUE`, got nothing"),
        (["weight", "goal"], "needs `ctl weight NAME=VALUE`, got 'goal'"),
        (["parameter", "goal", "1"], "needs `ctl parameter NAME=VALUE[,VALUE...]`, got goal 1"),
        (["pause", "--robot", "a/b"], "robot 'a/b' is not a valid name"),
        (["pause", "--connect", "foo"], "'foo' is not an endpoint"),
    ],
)
def test_bad_words_say_what_is_valid(capsys, words, message):
    assert main(["ctl", *words]) == 2
    assert message in capsys.readouterr().err


def test_every_verb_has_its_words():
    assert set(ctl.WORDS) == set(get_args(Verb))
