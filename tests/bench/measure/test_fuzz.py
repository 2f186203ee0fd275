"""The fuzzers' target, bounded: the campaign itself is `sumo-dist bench fuzz`."""

import logging

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sumo_dist.bench.measure import fuzz
from sumo_dist.bench.measure.fuzz_target import Target, samples
from sumo_dist.errors import UsageError
from sumo_dist.faults.tamper import nonsense
from sumo_dist.wire.codec import encode, seal, unseal

MESSAGES = samples(np.random.default_rng(0))
FUZZ = settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.fixture(scope="module")
def target():
    logging.disable(logging.ERROR)
    yield Target()
    logging.disable(logging.NOTSET)


def test_every_sample_is_accepted_and_reaches_its_handler(target):
    before = target.outcomes["accepted"]
    for message in MESSAGES:
        target.feed(target.seed(message))
    assert target.outcomes["accepted"] == before + len(MESSAGES)
    assert target.handled >= {"plan", "state", "status", "reply", "refusal", "request", "estimate"}


def test_the_target_notices_a_handler_that_breaks(target, monkeypatch):
    """Else the campaign would say nothing."""
    monkeypatch.setattr(target._watch, "trip", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        for message in MESSAGES:
            target.feed(target.seed(message))


@FUZZ
@given(data=st.binary(max_size=300))
def test_no_bytes_break_a_handler(target, data):
    target.feed(data)


@FUZZ
@given(message=st.sampled_from(MESSAGES), seed=st.integers(0, 2**32), times=st.integers(1, 4))
def test_no_well_sealed_nonsense_breaks_a_handler(target, message, seed, times):
    rng, payload = np.random.default_rng(seed), encode(message)
    for _ in range(times):
        payload = nonsense(payload, rng)
    target.deliver(type(message), payload)
    target.feed(target.seed(message)[:1] + unseal(seal(unseal(payload))))


def test_at_random_counts_what_became_of_its_inputs():
    outcomes = fuzz.at_random(fuzz.Options(inputs=300, fuzzer="random"))
    logging.disable(logging.NOTSET)
    assert sum(outcomes.values()) == 300
    assert 0 < outcomes["accepted"] < 300


def test_unknown_fuzzers_are_named():
    with pytest.raises(UsageError, match="unknown fuzzer 'foo'; valid: atheris, auto, random"):
        fuzz.Options(fuzzer="foo")
