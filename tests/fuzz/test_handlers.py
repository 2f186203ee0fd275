"""Messages that nobody would send, to every message handler; `--inputs` says how many.

The inputs are sealed with a right checksum: without one they would all end there.
"""

import logging
from itertools import groupby

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sumo_dist.faults.tamper import garbage
from sumo_dist.wire.codec import encode, seal, unseal
from sumo_dist.wire.messages import Message

from .conftest import DEFAULT_INPUTS
from .handlers import MessageHandlers, samples
from .nonsense import nonsense

MESSAGES = samples(np.random.default_rng(0))
FUZZ = settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
CHECKSUM_BYTES = 4


@pytest.fixture(scope="module")
def handlers():
    logging.disable(logging.ERROR)
    yield MessageHandlers()
    logging.disable(logging.NOTSET)


def test_every_sample_is_accepted_and_reaches_its_handler(handlers):
    before = handlers.outcomes["accepted"]
    for message in MESSAGES:
        handlers.feed(handlers.seed(message))
    assert handlers.outcomes["accepted"] == before + len(MESSAGES)
    assert {type(message) for message in MESSAGES} == set(Message.__subclasses__())
    assert handlers.handled >= {"plan", "state", "reply", "refusal", "request", "episode"}
    assert handlers.handled >= {"truth estimate", "lowpass estimate"}
    verbs = "weight", "parameter", "planner", "pause", "reset", "task", "stop"
    assert handlers.handled >= {f"command {verb}" for verb in verbs}
    assert handlers.handled >= {f"published {each}" for each in ("ack", "plan", "question")}


def test_a_handler_that_breaks_is_noticed(handlers, monkeypatch):
    """Else the fuzz tests would say nothing."""
    monkeypatch.setattr(handlers._watch, "trip", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        for message in MESSAGES:
            handlers.feed(handlers.seed(message))


@FUZZ
@given(data=st.binary(max_size=300))
def test_no_bytes_break_a_handler(handlers, data):
    handlers.feed(data)


@FUZZ
@given(message=st.sampled_from(MESSAGES), seed=st.integers(0, 2**32), times=st.integers(1, 4))
def test_no_well_sealed_nonsense_breaks_a_handler(handlers, message, seed, times):
    rng, payload = np.random.default_rng(seed), encode(message)
    for _ in range(times):
        payload = nonsense(payload, rng)
    handlers.deliver(type(message), payload)


@pytest.mark.timeout(0)  # a million inputs take the best part of an hour
def test_random_changes_of_valid_messages_break_no_handler(pytestconfig, outcomes):
    logging.disable(logging.ERROR)
    try:
        inputs = pytestconfig.getoption("--inputs", default=DEFAULT_INPUTS)
        rng, handlers = np.random.default_rng(1), MessageHandlers()
        seeds = [[handlers.seed(m) for m in of_kind] for _, of_kind in groupby(MESSAGES, type)]
        for _ in range(inputs):
            of_kind = seeds[rng.integers(len(seeds))]
            handlers.feed(changed(of_kind[rng.integers(len(of_kind))], rng))
    finally:
        logging.disable(logging.NOTSET)
    outcomes.update(handlers.outcomes)
    assert handlers.outcomes.total() == inputs
    assert 0 < handlers.outcomes["accepted"] < inputs


def changed(seed: bytes, rng: np.random.Generator) -> bytes:
    """Change a field of a message, or some of its bytes; the first byte is its kind."""
    kind, payload = seed[:1], seal(seed[1:])
    if rng.random() < 0.7:
        return kind + unseal(nonsense(payload, rng))
    return kind + garbage(payload, rng)[CHECKSUM_BYTES:]
