import os
import re
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.planner.evaluate import Evaluator
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.rollout import engine_identity
from sumo_dist.services import compiled, serving
from sumo_dist.services.worker import EvaluatorCache, WorkerOptions, run, unique_name
from sumo_dist.tasks import load_task
from sumo_dist.wire import finding, routers
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.codec import decode, encode
from sumo_dist.wire.keys import checked_name
from sumo_dist.wire.messages import RolloutReply, RolloutRequest
from sumo_dist.wire.session import open_router


@pytest.fixture(scope="module")
def asked(problem, config):
    knots = np.random.default_rng(0).uniform(-1, 1, (config.rollouts, config.nodes, 9))
    return RolloutRequest(
        run="run",
        worker="w-1",
        asker="o-1",
        robot="spot",
        number=3,
        iteration=0,
        shard=5,
        start=0,
        task="spot/move_box",
        task_hash=problem.hash,
        build=engine_identity()[1],
        settings=asdict(config),
        state=draw_start(problem.task, seed=2),
        memory=problem.policy.initial_memory(),
        parameters=problem.task.table.defaults.parameters,
        knots=knots.astype(np.float32),
        reply_budget_ms=0.0,
    )


@pytest.fixture(scope="module")
def cache():
    with EvaluatorCache(WorkerOptions(name="w-1")) as cache:
        yield cache


@pytest.fixture
def trusting(tmp_path):
    """One that may run the test's files."""
    with EvaluatorCache(WorkerOptions(name="w-1", trust=(tmp_path,))) as cache:
        yield cache


@pytest.fixture(scope="module")
def expected(problem, config, asked):
    with problem.engine(1) as engine:
        evaluator = Evaluator(problem, engine, config)
        return evaluator(asked.state, asked.memory, asked.parameters, asked.knots)


def test_costs_are_those_of_one_process(cache, asked, expected):
    reply, traces = cache.answer(asked)
    assert np.array_equal(reply.terms, expected.terms)
    assert reply.valid.all()
    assert (reply.worker, reply.shard, reply.number, reply.start) == ("w-1", 5, 3, 0)
    assert reply.refusal == ""
    assert reply.compute_ms > 0
    assert np.array_equal(traces.traces, expected.traces)


def test_a_shard_costs_what_its_rows_cost(cache, asked, expected):
    reply, _ = cache.answer(replace(asked, start=4, knots=asked.knots[4:7]))
    assert np.array_equal(reply.terms, expected.terms[4:7])
    assert reply.start == 4


def test_replies_can_travel(cache, asked):
    for request in (asked, replace(asked, task="spot/none")):
        reply, _ = cache.answer(request)
        assert decode(RolloutReply, encode(reply)).shard == reply.shard


def test_what_is_asked_again_is_answered_from_memory(cache, asked):
    first, _ = cache.answer(asked)
    again, _ = cache.answer(replace(asked, shard=6))
    assert np.array_equal(again.terms, first.terms)
    assert again.compute_ms == first.compute_ms  # measured once
    assert again.shard == 6


@pytest.mark.parametrize("changed", ["knots", "state", "parameters"])
def test_the_same_rows_of_the_same_plan_with_another_content_are_not(cache, asked, changed):
    """Such as from an optimizer that was restarted and makes the plan once more."""
    first, _ = cache.answer(asked)
    content = getattr(asked, changed)
    other = 0.999 * content + 0.001 if changed == "parameters" else content * np.float32(0.999)
    reply, _ = cache.answer(replace(asked, **{changed: other}))
    assert not np.array_equal(reply.terms, first.terms)


MINE = """
from dataclasses import replace
from sumo_dist.costs.terms import CostTerm
from sumo_dist.tasks import load_task

def dry(r):
    raise RuntimeError("the well is dry")

def task():
    box = load_task("spot/move_box")
    return replace(box, cost=(*box.cost, CostTerm("dry", dry, 1.0)))
"""


def test_a_task_that_raises_is_blamed_and_the_worker_goes_on(
    trusting, asked, expected, tmp_path, config
):
    path, cache = tmp_path / "mine.py", trusting
    path.write_text(MINE)
    digest = Problem.build(load_task(str(path)), planning_options(config)).hash
    reply, traces = cache.answer(replace(asked, task=str(path), task_hash=digest))
    assert reply.refusal == "cost term 'dry': mine.py, line 7: RuntimeError: the well is dry"
    assert reply.task_fails and traces is None
    other, _ = cache.answer(replace(asked, task="spot/none"))
    assert other.refusal and not other.task_fails
    after, _ = cache.answer(asked)
    assert np.array_equal(after.terms, expected.terms)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"task": "spot/none"}, "unknown task 'spot/none'; valid: "),
        ({"task_hash": "0123"}, "has hash .*, the optimizer's has 0123: the task's files differ"),
        ({"settings": {"rollouts": 3}}, "planner settings of another version; valid: "),
        ({"knots": np.zeros((2, 4, 9), np.float32)}, "knots have shape"),
        ({"knots": np.zeros((2, 5, 8), np.float32)}, "knots have shape"),
        ({"state": np.zeros(3)}, "state has shape"),
        ({"state": np.full(64, 1e300)}, "state "),
        ({"memory": np.zeros(3, np.float32)}, "memory has shape"),
        ({"parameters": np.zeros(3)}, "weights and parameters have shapes"),
        ({"parameters": np.full(4, 1e300)}, "parameter 'goal' must be from -8 to 8 m"),
    ],
)
def test_what_cannot_be_done_is_refused_by_name_and_harms_nothing(
    cache, asked, expected, change, reason
):
    reply, traces = cache.answer(replace(asked, **change))
    assert re.search(reason, reply.refusal)
    assert reply.terms.size == reply.valid.size == 0
    assert traces is None
    after, _ = cache.answer(asked)
    assert np.array_equal(after.terms, expected.terms)


def test_takes_up_another_config_when_asked_to(cache, asked, config, expected):
    shorter = replace(config, horizon=0.2)
    reply, _ = cache.answer(replace(asked, settings=asdict(shorter)))
    assert not np.array_equal(reply.terms, expected.terms)
    back, _ = cache.answer(asked)
    assert np.array_equal(back.terms, expected.terms)


def test_costs_know_no_weights(cache, asked, problem, config, expected):
    """Weights are the optimizer's alone: a task of other weights is the same to a worker."""
    heavier = tuple(replace(term, weight=3.0 * term.weight) for term in problem.task.cost)
    other = Problem.build(replace(problem.task, cost=heavier), planning_options(config))
    assert other.hash == problem.hash
    reply, _ = cache.answer(replace(asked, task_hash=other.hash))
    assert np.array_equal(reply.terms, expected.terms)


TASK_FILE = """
import numpy as np
from dataclasses import replace
from sumo_dist.costs.terms import CostTerm
from sumo_dist.tasks import load_task

def offset(r):
    return np.full(r.object.pos.shape[:2], {offset})

def task():
    base = load_task("spot/move_box")
    return replace(base, cost=(*base.cost, CostTerm("offset", offset, 1.0)))
"""


def test_a_task_file_that_has_changed_is_loaded_again(trusting, asked, config, tmp_path):
    """Between two sessions of a robot; the worker is the same. What it has compiled stays."""
    file = tmp_path / "offset.py"

    def answered():
        problem = Problem.build(load_task(str(file)), planning_options(config))
        request = replace(asked, task=str(file), task_hash=problem.hash, number=asked.number + 1)
        reply, _ = trusting.answer(request)
        assert reply.refusal == ""
        return reply.terms[:, -1], problem.hash

    file.write_text(TASK_FILE.format(offset=2.0))
    before, old = answered()
    file.write_text(TASK_FILE.format(offset=30.0))
    after, new = answered()
    assert old != new
    assert (before == 2.0).all()
    assert (after == 30.0).all()
    again, _ = trusting.answer(replace(asked, task=str(file), task_hash=old))
    assert (again.terms[:, -1] == 2.0).all()
    refused, _ = trusting.answer(replace(asked, task=str(file), task_hash="0123"))
    assert "the task's files differ between the hosts" in refused.refusal


@pytest.fixture
def builds(monkeypatch):
    """Tasks that are compiled, in turn."""
    built, build = [], Problem.build

    def counted(task, options):
        built.append(task.name)
        return build(task, options)

    monkeypatch.setattr(Problem, "build", counted)
    return built


def test_tasks_that_alternate_are_compiled_once_and_old_ones_forgotten(asked, config, builds):
    names = ("spot/move_box", "spot/move_cone", "spot/upright_cone")
    requests, start = [], asked.state
    for name in names:
        problem = Problem.build(load_task(name), planning_options(config))
        parameters = problem.task.table.defaults.parameters
        changes = {"task": name, "task_hash": problem.hash, "parameters": parameters}
        state = start if name == names[0] else draw_start(problem.task, seed=2)
        requests.append(replace(asked, state=state, knots=asked.knots[:1], **changes))
    builds.clear()
    with pytest.MonkeyPatch.context() as patch, EvaluatorCache(WorkerOptions(name="w")) as cache:
        for number in range(6):
            for request in requests[:2]:
                reply, _ = cache.answer(replace(request, number=number))
                assert reply.refusal == ""
        assert builds == [*names[:2]]
        patch.setattr(compiled, "KEPT", 2)
        cache.answer(requests[2])
        cache.answer(requests[1])
        assert builds == [*names]
        cache.answer(requests[0])
        assert builds == [*names, names[0]]


def test_an_asker_of_another_hash_costs_one_compilation(cache, asked, builds):
    for number in range(5):
        reply, _ = cache.answer(replace(asked, task_hash="4567", number=number))
        assert "has hash" in reply.refusal
    assert len(builds) == 1


@pytest.mark.parametrize("where", ["{0}/x.py", "{0}/ok/../x.py", "{0}/ok/link.py", "{0}/okay/x.py"])
def test_a_file_that_is_not_trusted_is_not_run(asked, tmp_path, where):
    ran = tmp_path / "ran"
    for folder in ("ok", "okay"):
        (tmp_path / folder).mkdir()
    for path in ("x.py", "okay/x.py"):
        (tmp_path / path).write_text(f"open({str(ran)!r}, 'w')")
    (tmp_path / "ok" / "link.py").symlink_to(tmp_path / "x.py")
    with EvaluatorCache(WorkerOptions(name="w", trust=(tmp_path / "ok",))) as cache:
        reply, _ = cache.answer(replace(asked, task=where.format(tmp_path)))
    assert re.fullmatch(
        r"task file \S+ is not trusted on this host: start the worker with --trust \S+",
        reply.refusal,
    )
    assert not ran.exists()
    assert not reply.task_fails


def test_more_rows_than_a_plan_has_are_refused(cache, asked, config):
    many = np.zeros((config.rollouts + 1, config.nodes, 9), np.float32)
    reply, _ = cache.answer(replace(asked, knots=many))
    assert reply.refusal == f"{len(many)} rows of a plan of {config.rollouts} rollouts"
    settings = {**asdict(config), "rollouts": 10**6}
    reply, _ = cache.answer(replace(asked, settings=settings, knots=many))
    assert "rollouts must be from 1 to 4096" in reply.refusal


def test_a_second_worker_of_the_same_name_ends_with_an_error_that_says_so(router, robot):
    stop = threading.Event()
    options = WorkerOptions(connect=router, name="twin", give_way=False)  # this is our process
    first = threading.Thread(target=run, args=(options, stop))
    with Bus.dial(router, robot) as bus:
        seen = threading.Event()
        bus.watch("worker", lambda member, alive: seen.set())
        first.start()
        try:
            assert seen.wait(30.0)
            with pytest.raises(SumoError, match=r"a worker named 'twin' is at .* already: give "):
                run(options, threading.Event())
            assert first.is_alive()
        finally:
            stop.set()
            first.join(30.0)


def test_a_name_is_free_again_once_its_worker_has_left(router, robot, eventually):
    """As after a crash: what was killed is seen for a moment."""
    stop, changes = threading.Event(), []
    with Bus.dial(router, robot) as bus:
        ghost = Bus.dial(router, robot)
        ghost.announce("worker", "w-1", engine_identity()[1])
        bus.watch("worker", lambda member, alive: changes.append(alive))
        worker = threading.Thread(
            target=run, args=(WorkerOptions(connect=router, name="w-1"), stop)
        )
        threading.Timer(0.4, ghost.close).start()
        worker.start()
        try:
            assert eventually(lambda: changes == [True, False, True], 30.0)
        finally:
            stop.set()
            worker.join(30.0)


@contextmanager
def working(options):
    """A worker in a thread."""
    stop = threading.Event()
    worker = threading.Thread(target=run, args=(replace(options, give_way=False), stop))
    worker.start()
    try:
        yield worker
    finally:
        stop.set()
        worker.join(30.0)


def test_a_worker_that_is_told_nothing_finds_the_router_and_says_whom_it_serves(
    asked, endpoint, tmp_path, monkeypatch, caplog, eventually
):
    monkeypatch.setenv(routers.VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setattr(finding, "DEFAULT_ENDPOINT", endpoint)
    caplog.set_level("INFO", logger="sumo_dist.worker")

    def said(text):
        return [r.getMessage() for r in caplog.records if text in r.getMessage()]

    with working(WorkerOptions(name="w-1")), ExitStack() as stack:
        stack.enter_context(open_router(endpoint))  # after the worker
        bus = stack.enter_context(Bus.dial(endpoint, "g1", run="run"))
        replies, workers = bus.inbox(RolloutReply, "o-1"), bus.watch("worker")
        assert eventually(lambda: workers.now, 30.0)
        asked = replace(asked, robot="g1")
        for number in (3, 4, 5):
            bus.publish(replace(asked, number=number))
            assert replies.get(timeout=60.0).refusal == ""
        for number in (6, 7, 8):
            bus.publish(replace(asked, number=number, task_hash="0123"))
            assert replies.get(timeout=60.0).refusal
        bus.publish(replace(asked, number=9))
        assert replies.get(timeout=60.0).refusal == ""
        line = f"serving g1 at {endpoint}: spot/move_box, 1 thread"
        assert eventually(lambda: len(said("serving g1")) == 3)
    whom, why, again = said("serving g1")
    assert whom == again == line
    assert "the task's files differ between the hosts" in why


def test_a_worker_that_nobody_needs_says_so_once(endpoint, monkeypatch, caplog, eventually):
    monkeypatch.setattr(serving, "PATIENCE_S", 0.2)
    with open_router(endpoint), working(WorkerOptions(connect=endpoint, name="w-1")):
        assert eventually(lambda: f"nobody plans at {endpoint}" in caplog.text, 30.0)
        time.sleep(1.0)
    assert caplog.text.count("nobody plans") == 1


def test_a_worker_does_not_choose_among_routers(tmp_path, monkeypatch, free_endpoint):
    monkeypatch.setenv(routers.VARIABLE, str(tmp_path))
    with ExitStack() as stack:
        endpoints = [free_endpoint(), free_endpoint()]
        for endpoint, what in zip(endpoints, ("one run", "another run"), strict=True):
            stack.enter_context(open_router(endpoint))
            note = routers.LocalRouter(endpoint, what, os.getpid())
            stack.enter_context(routers.left_note(note))
        with pytest.raises(UsageError, match="2 routers are here, choose one: ") as several:
            run(WorkerOptions(name="w-1", give_way=False), threading.Event())
    for endpoint, what in zip(endpoints, ("one run", "another run"), strict=True):
        assert f"--connect {endpoint} for {what}, process" in str(several.value)


def test_an_optimizer_of_another_build_ends_no_worker(endpoint, asked, caplog, eventually):
    """It is told, and whoever has the same build is served."""
    with (
        open_router(endpoint),
        working(WorkerOptions(connect=endpoint, name="w-1")),
        Bus.dial(endpoint, "spot", run="run") as bus,
    ):
        workers, replies = bus.watch("worker"), bus.inbox(RolloutReply, "o-1")
        assert eventually(lambda: workers.now, 30.0)
        bus.announce("optimizer", "old", "of-last-year")
        assert eventually(lambda: "optimizer old cannot be served: its build is" in caplog.text)
        bus.publish(asked)
        assert replies.get(timeout=60.0).refusal == ""


def test_one_worker_serves_two_robots_and_each_hears_its_own_answers(endpoint, asked, eventually):
    with ExitStack() as stack:
        stack.enter_context(open_router(endpoint))
        stack.enter_context(working(WorkerOptions(connect=endpoint, name="w-1")))
        inboxes = {}
        for robot in ("spot", "spot-2"):
            bus = stack.enter_context(Bus.dial(endpoint, robot, run=robot))
            inboxes[robot] = bus, bus.inbox(RolloutReply, f"o-{robot}")
        workers = bus.watch("worker")
        assert eventually(lambda: workers.now, 30.0)
        for number in range(3):
            for robot, (bus, _) in inboxes.items():
                mine = replace(asked, run=robot, robot=robot, asker=f"o-{robot}", number=number)
                bus.publish(mine)
            for robot, (_, replies) in inboxes.items():
                reply = replies.get(timeout=60.0)
                assert (reply.run, reply.number, reply.refusal) == (robot, number, "")
        for bus, replies in inboxes.values():
            assert replies.empty()
            assert not bus.rejected


@pytest.mark.parametrize(("give_way", "niceness"), [(True, 10), (False, 0)])
def test_a_worker_gives_way_unless_told_not_to(router, robot, give_way, niceness):
    code = (
        "import os, threading; from sumo_dist.services.worker import WorkerOptions, run\n"
        "stop = threading.Event(); stop.set(); before = os.nice(0)\n"
        f"run(WorkerOptions(connect={router!r}, name='w-1', give_way={give_way}), stop)\n"
        "print(os.nice(0) - before)"
    )
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    ours = os.nice(0)
    assert int(done.stdout) == min(niceness, 19 - ours)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")
def test_a_new_worker_has_answered_after_two_seconds_of_work(router, robot, asked):
    """From the start of its process to its first rows; on an idle machine work is all it takes."""
    command = [sys.executable, "-P", "-m", "sumo_dist", "rollout-worker", "--connect", router]
    with Bus.dial(router, robot, run="run") as bus:
        replies, joined = bus.inbox(RolloutReply, "o-1"), threading.Event()
        bus.watch("worker", lambda member, alive: joined.set())
        with subprocess.Popen([*command, "--name", "new"]) as process:
            try:
                assert joined.wait(60.0)
                bus.publish(replace(asked, worker="new", robot=robot))
                assert replies.get(timeout=60.0).refusal == ""
                stat = Path("/proc", str(process.pid), "stat").read_text().rpartition(")")[2]
                took = sum(map(int, stat.split()[11:15])) / os.sysconf("SC_CLK_TCK")
            finally:
                process.terminate()
    assert took < 2.0


def test_a_default_name_is_unique_on_the_bus():
    assert checked_name("worker", unique_name()) == unique_name()
