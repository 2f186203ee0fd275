"""What tests of several packages share: a router, a start, a Rerun file read back, waiting."""

import os
import signal
import socket
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow
import pytest

from sumo_dist.episode.assemble import draw_start
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.learned import Contract, LearnedPolicy
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.policies.network import Layer
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task
from sumo_dist.wire import routers
from sumo_dist.wire.session import open_router

USUAL = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}


def pytest_configure():
    """Let Ctrl-C and HUP act as usual on what tests start, also under nohup or a shell's `&`."""
    for number, handler in USUAL.items():
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, handler)


# As measured, the longest first; the first waits for most of its time, the second never does.
LONGEST = (
    *("hosts/test_run.py", "services/test_browser.py", "services/test_lockstep.py"),
    *("project/test_packaging.py", "services/test_sessions.py", "commands/test_run.py"),
    *("bench/tune/test_command.py", "services/test_pool.py", "faults/test_run.py"),
    *("security/test_attacks.py", "cases/test_recordings.py", "services/test_tracer.py"),
)


def pytest_collection_modifyitems(items):
    """Begin with the longest files, then those of most slow tests: none is left over in the end."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    place = {Path(__file__).parent / name: rank for rank, name in enumerate(LONGEST)}
    missing = [path for path in place if not path.is_file()]
    assert not missing, f"LONGEST names what is not there: {missing}"
    items.sort(key=lambda item: (place.get(item.path, len(place)), -slow[item.path]))


Table = dict[str, list[Any]]  # column -> rows


class Rrd(NamedTuple):
    """An .rrd read back: entity -> table.

    Attributes:
        static: what holds for all time.
        timed: the rest, its rows in order of time.
    """

    static: dict[str, Table]
    timed: dict[str, Table]


@pytest.fixture(scope="session", autouse=True)
def own_runs(tmp_path_factory):
    """Let no test find the runs of others on this machine, nor be found by them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(routers.VARIABLE, str(tmp_path_factory.mktemp("runtime", numbered=True)))
        yield


@pytest.fixture(scope="session", autouse=True)
def own_bytecode(tmp_path_factory):
    """Let what tests start find what Python has compiled, also where it may write nothing.

    Tests start hundreds of processes, and each would compile the whole package.
    """
    if not sys.dont_write_bytecode:
        yield
        return
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
        patch.setenv("PYTHONPYCACHEPREFIX", str(folder / "bytecode"))
        yield


@pytest.fixture(scope="session")
def read_rrd() -> Callable[[Path], Rrd]:
    """Return a function that reads an .rrd."""
    from rerun.chunk import RrdReader

    def read(path: Path) -> Rrd:
        parts: dict[bool, dict[str, list[pyarrow.Table]]] = {True: {}, False: {}}
        with warnings.catch_warnings():  # files that grow have no index at their end
            warnings.filterwarnings("ignore", "RRD file has no footer")
            reader = RrdReader(path)
        for chunk in reader.stream():
            table = pyarrow.Table.from_batches([chunk.to_record_batch()])
            parts[chunk.is_static].setdefault(chunk.entity_path, []).append(table)
        order = [("sim_time", "ascending"), ("rerun.controls.RowId", "ascending")]
        static = {e: pyarrow.concat_tables(tables) for e, tables in parts[True].items()}
        timed = {e: pyarrow.concat_tables(t).sort_by(order) for e, t in parts[False].items()}
        return Rrd(
            {entity: table.to_pydict() for entity, table in static.items()},
            {entity: table.to_pydict() for entity, table in timed.items()},
        )

    return read


@pytest.fixture(scope="session")
def short_run() -> Recording:
    """Half a second of spot/move_box, planned in this process with few and short rollouts."""
    planner = PlannerConfig("cem", rollouts=6, horizon=0.2)
    config = EpisodeConfig("spot/move_box", seed=3, planner=planner, time_limit=0.5)
    recording, _ = run_single(config, threads=1)
    return recording


@pytest.fixture(scope="session")
def eventually():
    def eventually(condition, timeout=5.0):
        """Wait until a condition holds; return whether it does."""
        deadline = time.monotonic() + timeout
        while not (met := condition()) and time.monotonic() < deadline:
            time.sleep(0.005)
        return bool(met)

    return eventually


def _free_endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture(scope="session")
def free_endpoint():
    """Return a function that names an endpoint nobody listens on."""
    return _free_endpoint


@pytest.fixture
def endpoint():
    """Name an endpoint that nobody listens on."""
    return _free_endpoint()


@pytest.fixture(scope="session")
def router():
    """Run one router for all tests in this process; each test uses a robot of its own."""
    endpoint = _free_endpoint()
    with open_router(endpoint):
        yield endpoint


@pytest.fixture
def robot(request):
    """Name a robot after the test."""
    return request.node.originalname.replace("_", "-")[:60]


@pytest.fixture(scope="session")
def move_box():
    return load_task("spot/move_box")


@pytest.fixture(scope="session")
def drawn_policy():
    """Return a function: a learned policy for a task whose weights are drawn by a seed."""

    def draw(task, seed, times=(0.0,), rate=20, **origin):
        problem = Problem.build(load_task(task), planning_options(PlannerConfig()))
        contract = Contract.of(problem, times, rate, {"seed": seed, **origin})
        sizes = sum(contract.inputs.values()), 8, len(times) * len(contract.actions)
        rng = np.random.default_rng(seed)
        weights = [
            (rng.standard_normal(shape) / np.sqrt(shape[1])).astype(np.float32)
            for shape in zip(sizes[1:], sizes[:-1], strict=True)
        ]
        biases = [rng.uniform(-0.3, 0.3, size).astype(np.float32) for size in sizes[1:]]
        layers = zip(weights, biases, ("elu", "tanh"), strict=True)
        return LearnedPolicy(contract, tuple(Layer(*layer) for layer in layers))

    return draw


@pytest.fixture(scope="session")
def policy_file(drawn_policy, tmp_path_factory):
    """Name the file of a policy for spot/move_box that has learnt nothing."""
    path = tmp_path_factory.mktemp("policy") / "drawn.onnx"
    drawn_policy("spot/move_box", seed=1).save(path)
    return path


@pytest.fixture(scope="session")
def first_state(move_box):
    return draw_start(move_box, seed=1)
