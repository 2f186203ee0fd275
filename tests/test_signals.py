import os
import signal
import threading
import time

import pytest

from sumo_dist import signals
from sumo_dist.signals import ENDING, interruptible, on_ending, set_on_ending, uninterrupted


@pytest.fixture(autouse=True)
def as_before():
    """Handlers as in a terminal; a shell's background jobs ignore SIGINT."""
    outside = signal.signal(signal.SIGINT, signal.default_int_handler)
    before = {number: signal.getsignal(number) for number in ENDING}
    yield
    assert {number: signal.getsignal(number) for number in ENDING} == before
    signal.signal(signal.SIGINT, outside)


@pytest.mark.parametrize("number", ENDING)
def test_a_command_that_has_begun_is_interrupted_by_each_of_them(number):
    with pytest.raises(KeyboardInterrupt), interruptible():
        os.kill(os.getpid(), number)
        time.sleep(30)


def test_a_second_signal_does_not_interrupt_the_first_ones_handling(monkeypatch):
    monkeypatch.setattr(signals, "GRACE_S", 3600.0)
    handled = []
    with interruptible():
        try:
            signal.raise_signal(signal.SIGHUP)
        except KeyboardInterrupt:
            signal.raise_signal(signal.SIGHUP)
            signal.raise_signal(signal.SIGTERM)
            handled.append(True)
    assert handled


def test_a_later_one_interrupts_again(monkeypatch):
    monkeypatch.setattr(signals, "GRACE_S", 0.0)
    with interruptible():
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)


def test_what_must_not_be_broken_off_comes_to_its_end_first():
    done = []
    with pytest.raises(KeyboardInterrupt), uninterrupted():
        signal.raise_signal(signal.SIGINT)
        done.append(True)
    assert done


def test_a_signal_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible():
            signal.raise_signal(signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_other_threads_change_no_handlers():
    found = []
    thread = threading.Thread(target=lambda: found.append(on_ending(lambda *_: None)))
    thread.start()
    thread.join()
    assert found == [{}]


def test_an_event_is_set_even_while_its_lock_is_held():
    """As it is for moments of each `wait`, in which a robot spends most of its time."""
    event, before = threading.Event(), {number: signal.getsignal(number) for number in ENDING}
    set_on_ending(event)
    try:
        with event._cond:
            signal.raise_signal(signal.SIGTERM)
        assert event.wait(10.0)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
