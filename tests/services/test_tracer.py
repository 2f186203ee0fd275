import logging
import socket
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.services.backlog import Backlog
from sumo_dist.services.candidates import Candidates
from sumo_dist.services.tracer import Tracer, TracerOptions, run
from sumo_dist.tasks import load_task
from sumo_dist.view import viewers
from sumo_dist.view.outputs import Outputs
from sumo_dist.view.replay import reports
from sumo_dist.view.rrd_file import RrdFile
from sumo_dist.view.run_logger import RunLogger
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import EpisodeEnd, EpisodeInfo, PlanMessage, Question, State, Traces
from sumo_dist.wire.notices import Ack, Event, Health, WorkerHealth, WorkerStatus
from sumo_dist.wire.session import open_router

ROLLOUTS = 6
COST = load_task("spot/move_box").table.defaults
TERMS, PARAMETERS = len(COST.weights), len(COST.parameters)

start_viewer = viewers._start


def report(number, finite=None):
    costs = np.arange(ROLLOUTS, dtype=float)[::-1] + 1.0
    finite = np.ones(ROLLOUTS, bool) if finite is None else np.array(finite)
    plan = Plan(number, 5 * number // 2, np.zeros((4, 9), np.float32), 1.5, "linear")
    made_of = np.where(finite, costs, 0.0), finite, np.ones(TERMS)
    return PlanReport(plan, *made_of, COST.weights, COST.parameters, 30.0, 1.0)


def info(run_id="r", number=1, task="spot/move_box"):
    config = EpisodeConfig(task, planner=PlannerConfig("cem"))
    return EpisodeInfo(run_id, config.to_json(), "hash", number)


def shard(number, start, count, worker="w", iteration=0, run_id="r", robot="spot"):
    paths = np.full((count, 2, 25, 3), number, np.float32)
    paths[:, 0, 0, 0] = np.arange(start, start + count)  # which rollout it is
    return Traces(run_id, worker, robot, number, iteration, start, paths)


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
    robot = request.node.originalname.replace("_", "-")[:60]
    stop = threading.Event()
    changes = {"viewer": "none", **getattr(request, "param", {})}
    options = TracerOptions(out=tmp_path, connect=router, robot=robot, **changes)

    def start(tells=True):
        listens = threading.Event()
        bus = Bus.dial(router, robot, run="r")
        bus.announce("worker", "w")
        bus.watch("tracer", lambda member, alive: listens.set())
        thread.start()
        assert listens.wait(60)
        time.sleep(0.2)  # until the router has told this side of its subscriptions
        if tells:
            bus.publish(info())
        return bus

    thread = threading.Thread(target=run, args=(options, stop))
    yield start, thread, stop
    stop.set()
    thread.join(60)
    assert not thread.is_alive()


def publish_run(bus, ticks=13, run_id="r", task="spot/move_box"):
    state = draw_start(load_task(task), 1)
    for tick in range(ticks):
        time.sleep(0.02)  # a burst would be thinned by the bus, which never makes a sender wait
        bus.publish(State(run_id, tick, state))
        if tick % 5 == 0:
            number = tick // 5
            bus.publish(shard(number, 0, 3, run_id=run_id, robot=bus.robot))
            bus.publish(PlanMessage.of(run_id, report(number)))
            bus.publish(PlanMessage.of(run_id, report(number)))  # as in lockstep, asked again
            bus.publish(shard(number, 3, 3, run_id=run_id, robot=bus.robot))
    time.sleep(0.02)
    bus.publish(Event(run_id, "optimizer", "warning", "a plan was late"))
    time.sleep(0.02)
    for refused, state in ((0, "answers"), (8, "answers")):
        told = {"refused": refused, "mode": state}
        bus.publish(Health("", "optimizer", "realtime", told))
        time.sleep(0.02)
        bus.publish(WorkerHealth.of("", "o", [WorkerStatus("w", state, 300.0, refused, 0.1)]))
        time.sleep(0.02)
    bus.publish(Ack(run_id, 3, "tester", 12, "no such term"))
    bus.publish(Ack(run_id, 4, "tester", 12, ""))
    time.sleep(0.02)


def end_run(bus, thread, reason="success", run_id="r"):
    """Say that the run is over until the tracer has heard it: the bus may drop a message."""
    for _ in range(60):
        bus.publish(EpisodeEnd(run_id, 12, reason, reason == "success", True))
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
    assert [len(strips) for strips in samples] == [6, 6]  # of every second plan
    assert timed["/verdict"]["TextDocument:text"][-1][0].startswith("**ended: success**")
    elites = np.array(timed["/world/plan/elites"]["LineStrips3D:strips"][0])
    assert list(elites[::2, 0, 0]) == [5, 4, 3]  # the cheapest are the last
    assert len(timed["/plots/cost"]["sim_time"]) == 3
    assert timed["/plots/workers"]["Scalars:scalars"][-1] == [1.0, 1.0]
    assert timed["/plots/pace"]["Scalars:scalars"] == [[300.0] * 3]
    assert timed["/workers/w"]["StateChange:state"] == [["answers"]]
    assert timed["/robot"]["StateChange:state"] == [["walking"], ["success"]]
    assert timed["/health/optimizer/refused"]["Scalars:scalars"] == [[0.0]]  # once a second
    assert timed["/health/optimizer/mode"]["TextLog:text"] == [["answers"]]
    texts = [text[0] for text in timed["/events"]["TextLog:text"]]
    assert sorted(set(texts)) == [
        "command 3 of tester refused: no such term",
        "command 4 of tester carried out",
        "optimizer: a plan was late",
        "the run has ended: success",
    ]
    assert texts.count("the run has ended: success") == 1  # though it is told until it is heard


def test_of_a_plan_in_several_iterations_the_last_is_shown_also_where_they_were_changed(
    tracing, tmp_path, read_rrd
):
    """As by `ctl planner iterations=2`: the episode began with one."""
    start, thread, _ = tracing
    state = draw_start(load_task("spot/move_box"), 1)
    settings = vars(PlannerConfig("cem", iterations=2))
    question = Question(
        *("r", 0, 0, "lockstep", 1.0, state, np.zeros(12, np.float32), None),
        *(COST.weights, COST.parameters, settings),
    )
    with start() as bus:
        publish_run(bus, ticks=1)  # the plan 0 of one iteration
        bus.publish(question)
        time.sleep(0.2)
        for iteration in (0, 1):
            paths = shard(2, 0, ROLLOUTS, iteration=iteration)  # every second plan is drawn
            own = {"robot": bus.robot, "traces": np.full_like(paths.traces, 7.0 + iteration)}
            bus.publish(replace(paths, **own))
            time.sleep(0.1)
        bus.publish(PlanMessage.of("r", report(2)))
        end_run(bus, thread)
    samples = read_rrd(tmp_path / "run.rrd").timed["/world/plan/samples"]["LineStrips3D:strips"]
    assert np.unique(np.array(samples[-1])).tolist() == [8.0]


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

    def told():
        return [r.getMessage() for r in caplog.records if r.name == "sumo_dist.tracer"]

    with caplog.at_level(logging.WARNING), start() as bus:
        ticks = iter(range(1000))
        while not told():  # topics have no order: the first may come before the episode
            bus.publish(State("r", next(ticks), np.zeros(7)))  # of another robot
            time.sleep(0.05)
        for _ in range(3):
            bus.publish(State("r", next(ticks), np.zeros(7)))
            time.sleep(0.05)
        end_run(bus, thread, "timeout")
    assert len(told()) == 1
    assert told()[0].startswith("cannot show a State")
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


def test_each_episode_of_a_session_has_a_file_of_its_own(tracing, tmp_path, read_rrd):
    """A reset or another task begins one, and nothing of the one before is in its file."""
    start, thread, _ = tracing
    with start() as bus:
        publish_run(bus)
        for _ in range(3):
            bus.publish(EpisodeEnd("r", 12, "replaced: task by tester", False, False))
        time.sleep(1.0)  # as a robot that puts the next episode together: topics have no order
        bus.publish(info("r2", 2, "spot/move_tire"))
        bus.publish(info("r2", 2, "spot/move_tire"))  # as when a question is repeated
        publish_run(bus, 6, "r2", "spot/move_tire")
        bus.publish(State("r", 13, draw_start(load_task("spot/move_box"), 1)))  # late
        assert thread.is_alive()
        end_run(bus, thread, run_id="r2")
    first = read_rrd(tmp_path / "run.rrd")
    second = read_rrd(tmp_path / "episode-2" / "run.rrd")
    assert not (tmp_path / "episode-2" / "run-2.rrd").exists()
    assert len(set(first.timed["/world/poses"]["sim_time"])) == 13
    assert len(set(second.timed["/world/poses"]["sim_time"])) == 6
    about = [str(each.static["/about/scene"]) for each in (first, second)]
    assert "move_box" in about[0]
    assert "move_tire" in about[1]
    told = [text[0] for text in first.timed["/events"]["TextLog:text"]]
    assert "the run has ended: replaced: task by tester" in told
    told = [text[0] for text in second.timed["/events"]["TextLog:text"]]
    assert "the run has ended: success" in told


@pytest.mark.parametrize("tracing", [{"linger": True}], indirect=True)
def test_one_that_lingers_shows_the_next_robots_session_too(tracing, tmp_path, read_rrd):
    start, thread, stop = tracing
    with start() as bus:
        publish_run(bus, 3)
        for _ in range(3):
            bus.publish(EpisodeEnd("r", 2, "success", True, True))
        time.sleep(1.0)
        bus.publish(info("next", 1, "spot/move_tire"))
        publish_run(bus, 4, "next", "spot/move_tire")
        assert thread.is_alive()
        stop.set()
        thread.join(60)
    first, second = (read_rrd(tmp_path / name) for name in ("run.rrd", "run-2.rrd"))
    assert len(set(first.timed["/world/poses"]["sim_time"])) == 3
    assert len(set(second.timed["/world/poses"]["sim_time"])) == 4
    assert "move_tire" in str(second.static["/about/scene"])


def test_what_comes_before_any_episode_is_not_shown(tracing, tmp_path):
    start, _, stop = tracing
    with start(tells=False) as bus:
        publish_run(bus, 3)
        stop.set()
    assert list(tmp_path.iterdir()) == []


def test_an_episode_that_cannot_be_shown_is_told_and_the_next_one_is(caplog):
    opened = []

    def open_logger(told):
        if told.run == "bad":
            raise ValueError("no disk")
        opened.append(told.run)
        raise ValueError("enough")

    tracer = Tracer(open_logger)
    with caplog.at_level(logging.WARNING):
        tracer.show(info("bad"))
        tracer.show(State("bad", 0, np.zeros(64)))
        tracer.show(info("good", 2))
    assert opened == ["good"]
    assert caplog.text.count("cannot show a EpisodeInfo") == 1
    assert "no disk" in caplog.text


def question(tick, short_run, **settings):
    config = EpisodeConfig.of(short_run.config["episode"]).planner
    return Question(
        *("r", -1, tick, "realtime", 1.0, short_run.estimates[tick], short_run.memories[tick]),
        *(None, COST.weights, COST.parameters, {**vars(config), **settings}),
    )


def test_a_plan_that_is_there_before_its_state_is_rolled_out_when_that_comes(
    short_run, tmp_path, read_rrd
):
    outputs = Outputs("r", RrdFile(tmp_path / "a.rrd", pytest.fail))

    def open_logger(told):
        config = EpisodeConfig.of(short_run.config["episode"])
        return RunLogger(outputs, load_task(config.task), config, distributed=True)

    with outputs:
        tracer = Tracer(open_logger, tmp_path)
        tracer.show(info())
        tracer.show(State("r", 0, short_run.states[0]))
        plan = list(reports(short_run))[1]  # due at tick 2
        tracer.show(question(1, short_run))
        tracer.show(PlanMessage.of("r", plan))
        tracer.show(question(3, short_run, nodes=7))  # the state at tick 2 was not heard
        tracer.show(question(4, short_run))
        tracer.flush()
    timed = read_rrd(tmp_path / "a.rrd").timed
    ways = timed["/world/plan/way/base"]["sim_time"]
    assert [round(time.total_seconds() / 0.02) for time in ways] == [3]
    assert "/charts/knots/lines" not in timed  # the plan is of other settings by now


@pytest.mark.parametrize("tracing", [{"viewer": "web"}], indirect=True)
def test_a_viewer_that_is_killed_is_told_and_the_run_is_recorded(
    tracing, tmp_path, caplog, read_rrd, monkeypatch
):
    opened = []
    monkeypatch.setattr(viewers, "_start", lambda *a: opened.append(start_viewer(*a)) or opened[0])
    start, thread, _ = tracing
    with caplog.at_level(logging.INFO), start() as bus:
        deadline = time.monotonic() + 60.0
        while "watch the run" not in caplog.text:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        opened[0].kill()
        opened[0].wait()
        publish_run(bus)
        end_run(bus, thread)
    told = [r.getMessage() for r in caplog.records if r.name == "sumo_dist.tracer"]
    assert told[0].startswith("watch the run at http://127.0.0.1:")
    assert told[1:] == ["the viewer has ended; the run goes on and is recorded"]
    assert len(set(read_rrd(tmp_path / "run.rrd").timed["/world/poses"]["sim_time"])) == 13
