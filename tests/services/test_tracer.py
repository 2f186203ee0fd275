import logging
import socket
import threading
import time

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.services.tracer import Backlog, Candidates, TracerOptions, run
from sumo_dist.tasks import load_task
from sumo_dist.view import viewers
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import Event, Health, PlanMessage, RunEnd, State, Traces
from sumo_dist.wire.session import open_router

ROLLOUTS, TERMS = 6, 3

start_viewer = viewers._start


def report(number, finite=None):
    costs = np.arange(ROLLOUTS, dtype=float)[::-1] + 1.0
    finite = np.ones(ROLLOUTS, bool) if finite is None else np.array(finite)
    plan = Plan(number, 5 * number // 2, np.zeros((4, 2), np.float32), 1.5, "linear")
    return PlanReport(plan, np.where(finite, costs, 0.0), finite, np.ones(TERMS), 30.0, 1.0)


def shard(number, start, count, worker="w", iteration=0):
    paths = np.full((count, 2, 25, 3), number, np.float32)
    paths[:, 0, 0, 0] = np.arange(start, start + count)  # which rollout it is
    return Traces("r", worker, number, iteration, start, paths)


def test_a_full_backlog_drops_the_oldest_and_counts():
    backlog = Backlog(limit=3)
    for tick in range(5):
        backlog.put(State("r", tick, np.zeros(1)))
    assert backlog.dropped == 2
    assert [backlog.get(0.0).tick for _ in range(3)] == [2, 3, 4]
    assert backlog.get(0.01) is None


def test_candidates_are_shown_when_all_shards_are_there():
    candidates = Candidates()
    candidates.add_shard(shard(0, 3, 3))
    candidates.add_plan(report(0))
    assert not list(candidates.ready())
    candidates.add_shard(shard(0, 0, 3))
    [(_, costs, paths)] = candidates.ready()
    assert np.array_equal(costs, report(0).costs)
    assert np.array_equal(paths[:, 0, 0, 0], np.arange(ROLLOUTS))
    assert not list(candidates.ready())


def test_candidates_whose_paths_do_not_come_are_left_out_after_a_while():
    candidates = Candidates()
    for number in range(6):
        candidates.add_plan(report(number))
        candidates.add_shard(shard(number, 0, 4))
        shown = list(candidates.ready())
        assert len(shown) == (number >= 4)
    [(plan, costs, _)] = shown
    assert plan.plan.number == 1
    assert list(np.isfinite(costs)) == [True] * 4 + [False] * 2


def test_a_candidate_that_diverged_needs_no_path():
    candidates = Candidates()
    candidates.add_plan(report(0, finite=[True, False, True, True, True, False]))
    candidates.add_shard(shard(0, 0, 1))
    candidates.add_shard(shard(0, 2, 3))
    [(_, costs, _)] = candidates.ready()
    assert list(np.isfinite(costs)) == [True, False, True, True, True, False]


def test_paths_of_plans_that_never_come_are_forgotten():
    candidates = Candidates()
    for number in range(1000):
        candidates.add_shard(shard(number, 0, 3))
    assert len(candidates._shards) <= 16


@pytest.fixture(scope="module")
def router():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with open_router(endpoint):
        yield endpoint


@pytest.fixture
def tracing(router, tmp_path, request):
    """A tracer on a bus of its own, and that bus; stopped at the end."""
    robot = request.node.name.replace("_", "-")[:60]
    stop = threading.Event()
    viewer = getattr(request, "param", "none")
    options = TracerOptions(
        EpisodeConfig("spot/move_box"), tmp_path, router, robot, "r", viewer=viewer
    )

    def start():
        listens = threading.Event()
        bus = Bus.dial(router, robot, run="r")
        bus.announce("worker", "w")
        bus.watch("tracer", lambda member, alive: listens.set())
        thread.start()
        assert listens.wait(20)
        time.sleep(0.2)  # until the router has told this side of its subscriptions
        return bus

    thread = threading.Thread(target=run, args=(options, stop))
    yield start, thread, stop
    stop.set()
    thread.join(20)
    assert not thread.is_alive()


def publish_run(bus, ticks=13):
    state = draw_start(load_task("spot/move_box"), 1)
    for tick in range(ticks):
        time.sleep(0.02)  # a burst would be thinned by the bus, which never makes a sender wait
        bus.publish(State("r", tick, state))
        if tick % 5 == 0:
            number = tick // 5
            bus.publish(shard(number, 0, 3))
            bus.publish(PlanMessage.of("r", report(number)))
            bus.publish(PlanMessage.of("r", report(number)))  # as in lockstep, when asked again
            bus.publish(shard(number, 3, 3))
    time.sleep(0.02)
    bus.publish(Event("r", "optimizer", "warning", "a plan was late"))
    time.sleep(0.02)
    for lost in (0, 8):
        told = {"w state": "answers", "w rollouts/s": 300, "w lost": lost}
        bus.publish(Health("r", "optimizer", "realtime", told))
        time.sleep(0.02)


def end_run(bus, thread, reason="success"):
    """Say that the run is over until the tracer has heard it: the bus may drop a message."""
    for _ in range(40):
        bus.publish(RunEnd("r", 12, reason, reason == "success"))
        thread.join(0.5)
        if not thread.is_alive():
            return
    raise AssertionError("the tracer does not end")


def test_a_run_on_the_bus_becomes_a_file_and_the_tracer_ends_with_it(tracing, tmp_path, read_rrd):
    start, thread, _ = tracing
    with start() as bus:
        publish_run(bus)
        end_run(bus, thread)
    timed = read_rrd(tmp_path / "run.rrd").timed
    assert len(set(timed["/world/poses"]["sim_time"])) == 13
    samples = timed["/world/plan/samples"]["LineStrips3D:strips"]
    assert [len(strips) for strips in samples] == [6, 6, 6]
    elites = np.array(timed["/world/plan/elites"]["LineStrips3D:strips"][0])
    assert list(elites[::2, 0, 0]) == [5, 4, 3]  # the cheapest are the last
    assert len(timed["/plots/cost"]["sim_time"]) == 3
    assert timed["/plots/workers/alive"]["Scalars:scalars"][-1] == [1.0]
    assert timed["/plots/pace/w"]["Scalars:scalars"] == [[300.0], [300.0]]
    assert timed["/health/optimizer/w\\ lost"]["Scalars:scalars"] == [[0.0], [8.0]]
    assert timed["/health/optimizer/w\\ state"]["TextLog:text"] == [["answers"]]
    texts = [text[0] for text in timed["/events"]["TextLog:text"]]
    assert sorted(texts) == ["optimizer: a plan was late", "the run has ended: success"]


def test_what_a_tracer_that_died_has_written_is_left_alone(tracing, tmp_path, read_rrd):
    start, thread, _ = tracing
    (tmp_path / "run.rrd").write_bytes(b"of before")
    with start() as bus:
        publish_run(bus, ticks=3)
        end_run(bus, thread)
    assert (tmp_path / "run.rrd").read_bytes() == b"of before"
    assert len(read_rrd(tmp_path / "run-2.rrd").timed["/world/poses"]["sim_time"]) > 0


def test_without_a_place_for_the_file_it_says_so_once_and_goes_on(tracing, tmp_path, caplog):
    start, thread, _ = tracing
    (tmp_path / "run.rrd").mkdir()
    with caplog.at_level(logging.WARNING), start() as bus:
        publish_run(bus)
        end_run(bus, thread)
    assert [r.getMessage() for r in caplog.records if r.name == "sumo_dist.tracer"] == [
        f"{tmp_path / 'run.rrd'} cannot be written: Is a directory"
    ]


def test_what_cannot_be_shown_is_left_out_and_told_once(tracing, tmp_path, caplog, read_rrd):
    start, thread, _ = tracing
    with caplog.at_level(logging.WARNING), start() as bus:
        for tick in (0, 1):
            bus.publish(State("r", tick, np.zeros(7)))  # of another robot
        time.sleep(0.1)
        end_run(bus, thread, "timeout")
    told = [r.getMessage() for r in caplog.records if r.name == "sumo_dist.tracer"]
    assert len(told) == 1
    assert told[0].startswith("cannot show a State")
    assert "/events" in read_rrd(tmp_path / "run.rrd").timed


def test_it_stops_when_told_though_the_run_goes_on(tracing, tmp_path, read_rrd):
    start, thread, stop = tracing
    state = draw_start(load_task("spot/move_box"), 1)
    with start() as bus:
        for tick in range(200):
            bus.publish(State("r", tick, state))
            time.sleep(0.01)
            if tick == 50:
                stop.set()
            if not thread.is_alive():
                break
        assert 50 < tick < 199
    assert len(read_rrd(tmp_path / "run.rrd").timed["/world/poses"]["sim_time"]) > 0


@pytest.mark.parametrize("tracing", ["web"], indirect=True)
def test_a_viewer_that_is_killed_is_told_and_the_run_is_recorded(
    tracing, tmp_path, caplog, read_rrd, monkeypatch
):
    opened = []
    monkeypatch.setattr(viewers, "_start", lambda *a: opened.append(start_viewer(*a)) or opened[0])
    start, thread, _ = tracing
    with caplog.at_level(logging.INFO), start() as bus:
        while "watch the run" not in caplog.text:
            time.sleep(0.05)
        opened[0].kill()
        opened[0].wait()
        publish_run(bus)
        end_run(bus, thread)
    told = [r.getMessage() for r in caplog.records if r.name == "sumo_dist.tracer"]
    assert told[0].startswith("watch the run at http://127.0.0.1:")
    assert told[1:] == ["the viewer has ended; the run goes on and is recorded"]
    assert len(set(read_rrd(tmp_path / "run.rrd").timed["/world/poses"]["sim_time"])) == 13
