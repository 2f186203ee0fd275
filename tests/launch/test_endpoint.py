"""The endpoint that a router gets."""

import socket
import threading
from contextlib import ExitStack

import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.launch import endpoint as endpoints
from sumo_dist.launch.endpoint import router_endpoint
from sumo_dist.wire import routers
from sumo_dist.wire.routers import local_routers
from sumo_dist.wire.session import open_router, port_of


@pytest.fixture(autouse=True)
def usual(tmp_path, monkeypatch, free_endpoint):
    """The usual endpoint, here one that nobody else has."""
    monkeypatch.setenv(routers.VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setattr(endpoints, "DEFAULT_ENDPOINT", free_endpoint())
    return endpoints.DEFAULT_ENDPOINT


def test_the_usual_one_is_taken_if_it_is_free_and_a_file_says_so(usual):
    with router_endpoint(None, "spot/move_box") as endpoint:
        assert endpoint == usual
        assert [(r.endpoint, r.what) for r in local_routers()] == [(usual, "spot/move_box")]
    assert local_routers() == []


def test_of_many_runs_that_begin_at_once_each_has_its_own(usual):
    begin, end, got = threading.Barrier(6), threading.Event(), []

    def run():
        begin.wait(30)
        with router_endpoint(None, "") as endpoint, open_router(endpoint):
            got.append(endpoint)
            end.wait(30)

    threads = [threading.Thread(target=run) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(1.0)
    end.set()
    for thread in threads:
        thread.join()
    assert len(set(got)) == 6
    assert usual in got


def test_a_port_that_somebody_else_listens_on_is_left_alone(usual):
    with socket.create_server(("127.0.0.1", port_of(usual))):
        with router_endpoint(None, "") as endpoint:
            assert endpoint != usual
        with (
            pytest.raises(SumoError, match=f"cannot listen on {usual}: the port is taken, perhaps"),
            router_endpoint(usual, ""),
        ):
            pass


def test_who_has_a_given_port_is_named(usual):
    with ExitStack() as stack:
        stack.enter_context(router_endpoint(usual, "g1/box_push in runs/a"))
        taken = r"the port is taken, by g1/box_push in runs/a \(process \d+\)"
        for given in (usual, usual.replace("127.0.0.1", "0.0.0.0")):
            with pytest.raises(SumoError, match=taken):
                stack.enter_context(router_endpoint(given, ""))
        assert len(local_routers()) == 1


def test_port_0_is_a_free_one_and_what_is_reached_is_this_machine():
    with router_endpoint("tcp/0.0.0.0:0", "") as endpoint:
        assert endpoint.startswith("tcp/0.0.0.0:")
        (router,) = local_routers()
        assert router.endpoint == f"tcp/127.0.0.1:{port_of(endpoint)}"


def test_what_is_no_endpoint_is_refused():
    with pytest.raises(UsageError, match="'foo' is not an endpoint"), router_endpoint("foo", ""):
        pass
