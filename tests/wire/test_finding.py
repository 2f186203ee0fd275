"""Finding robots by asking the routers that there are."""

import os
from contextlib import ExitStack

import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.wire import finding, routers
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.finding import Place, Search
from sumo_dist.wire.routers import LocalRouter, left_note
from sumo_dist.wire.session import open_router


@pytest.fixture
def machine(tmp_path, monkeypatch, free_endpoint):
    """Return a function that has a router with robots on this machine; it returns its endpoint."""
    monkeypatch.setenv(routers.VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setattr(finding, "DEFAULT_ENDPOINT", free_endpoint())
    with ExitStack() as stack:

        def router(*robots, what="a run", role="robot", starts=True):
            endpoint = free_endpoint()
            stack.enter_context(left_note(LocalRouter(endpoint, what, os.getpid())))
            if starts:
                stack.enter_context(open_router(endpoint))
            for robot in robots:
                bus = stack.enter_context(Bus.dial(endpoint, robot))
                bus.announce(role, "main")
            return endpoint

        yield router


def test_nobody_is_found_at_once_and_in_one_line(machine):
    with pytest.raises(SumoError, match=r"no robot is here: this user has no run with workers"):
        Search().one()
    with pytest.raises(SumoError, match=r"no robot named go2 is here"):
        Search(robot="go2").one()


def test_the_one_that_is_there_is_found_whatever_its_name_and_port(machine):
    endpoint = machine("go2", what="go2/fetch in runs/x")
    place = Search().one()
    assert place == Place(endpoint, "go2", "go2/fetch in runs/x")
    assert str(place) == f"go2 (go2/fetch in runs/x) at {endpoint}"
    assert Search(connect=endpoint).one() == Place(endpoint, "go2")
    assert Search(robot="go2").one() == place


def test_what_is_named_is_not_looked_for(machine, free_endpoint):
    nobody = free_endpoint()
    assert Search(nobody, "spot").one() == Place(nobody, "spot")


def test_a_router_at_the_usual_port_is_found_without_a_file(machine, monkeypatch, free_endpoint):
    usual = free_endpoint()
    monkeypatch.setattr(finding, "DEFAULT_ENDPOINT", usual)
    with open_router(usual), Bus.dial(usual, "spot") as bus:
        bus.announce("optimizer", "main")  # its robot is between two lives, say
        assert Search().one() == Place(usual, "spot")


def test_a_bus_on_which_there_are_only_workers_is_nobodys(machine):
    endpoint = machine("spot", role="worker")
    with pytest.raises(SumoError, match=f"no robot answers at {endpoint}: it is starting, or has"):
        Search().one()


@pytest.mark.parametrize(
    "robots", [["spot"], ["g1"], ["g1", "spot"], ["spot", "go2"]], ids=" and ".join
)
def test_several_are_named_with_the_options_that_choose_one(machine, robots):
    machine(*robots, what="one run")
    machine("g1", what="another run")
    with pytest.raises(UsageError) as several:
        Search().one()
    said = str(several.value)
    assert said.startswith(f"{len(robots) + 1} robots are here, choose one: ")
    listed = said.partition("choose one: ")[2].split("; ")
    assert len(listed) == len(robots) + 1
    for place in listed:
        choice = place.partition(" for ")[0].split()
        chosen = dict(zip(choice[::2], choice[1::2], strict=True))
        found = Search(chosen.get("--connect"), chosen.get("--robot")).one()
        assert f" for {found.robot} (" in place
        assert place.endswith(f" at {found.endpoint}")


def test_a_router_that_does_not_answer_is_told_and_keeps_nobody(machine):
    machine("spot")
    machine(what="a run that hangs", starts=False)
    look = Search().look()
    assert [place.robot for place in look.places] == ["spot"]
    assert [router.what for router in look.silent] == ["a run that hangs"]
