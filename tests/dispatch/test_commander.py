import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from sumo_dist.dispatch import commander
from sumo_dist.dispatch.commander import Commander
from sumo_dist.dispatch.operator import BusOperator
from sumo_dist.errors import UsageError
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import POOL
from sumo_dist.wire.notices import Drain


@pytest.fixture
def dial(router):
    buses = []

    def dialled(robot="spot"):
        buses.append(Bus.dial(router, robot))
        return buses[-1]

    yield dialled
    for bus in buses:
        bus.close()


def test_commands_from_several_threads_each_get_their_own_answer(dial):
    stop, arrived, taken = threading.Event(), threading.Event(), []
    operator = BusOperator(dial(), stop, arrived.set)

    def answer():
        while not stop.is_set():
            arrived.wait(0.1)
            arrived.clear()
            for command in operator.take(0, 0.0):
                taken.append(command.value)
                operator.answer(
                    command, int(command.value), "odd" if int(command.value) % 2 else ""
                )

    robot = threading.Thread(target=answer)
    robot.start()
    give = Commander(dial()).give
    with ThreadPoolExecutor(8) as threads:
        acks = list(threads.map(lambda n: give("step", value=str(n)), range(40)))
    stop.set()
    robot.join()
    assert [ack.tick for ack in acks] == list(range(40))
    assert [ack.refusal for ack in acks] == ["", "odd"] * 20
    assert sorted(map(int, taken)) == list(range(40))  # each was carried out once


def test_where_nobody_answers_it_gives_up(dial, monkeypatch):
    monkeypatch.setattr(commander, "PATIENCE_S", 0.3)
    assert Commander(dial("nobody")).give("pause") is None


def test_a_worker_is_drained_when_it_has_gone(dial, monkeypatch):
    told, worker = threading.Event(), dial(POOL)
    worker.subscribe(Drain, lambda drain: told.set(), address="w")
    worker.announce("worker", "w")
    stubborn = dial(POOL)
    stubborn.announce("worker", "stubborn")
    own = Commander(dial())
    leaves = threading.Thread(target=lambda: told.wait(10) and worker.close())
    leaves.start()
    assert own.drain("w")
    leaves.join()
    monkeypatch.setattr(commander, "PATIENCE_S", 0.3)
    assert not own.drain("stubborn")
    with pytest.raises(UsageError, match="unknown worker 'other'; valid: stubborn"):
        own.drain("other")
