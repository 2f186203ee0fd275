"""Each way to spoil a message spoils it, and its receiver notices."""

import numpy as np
import pytest

from sumo_dist.faults.tamper import TAMPERS
from sumo_dist.wire.codec import decode, encode
from sumo_dist.wire.messages import RolloutReply
from sumo_dist.wire.schema import WireError

from .handlers import samples
from .nonsense import nonsense

MESSAGES = samples(np.random.default_rng(0))
REPLY = next(m for m in MESSAGES if isinstance(m, RolloutReply))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
@pytest.mark.parametrize(
    ("kind", "reason"), [("garbage", "checksum"), ("truncate", "checksum"), ("version", "version")]
)
def test_spoilt_messages_are_rejected(message, kind, reason, rng):
    for _ in range(20):
        with pytest.raises(WireError) as caught:
            decode(type(message), TAMPERS[kind](encode(message), rng))
        assert caught.value.reason == reason


def test_a_lie_is_not_finite_and_only_replies_lie(rng):
    with pytest.raises(WireError, match="non-finite: terms"):
        decode(RolloutReply, TAMPERS["lie"](encode(REPLY), rng))
    for message in MESSAGES:
        if not isinstance(message, RolloutReply):
            assert TAMPERS["lie"](encode(message), rng) == encode(message)


def test_a_misshapen_reply_is_a_valid_message_of_fewer_rows(rng):
    reply = decode(RolloutReply, TAMPERS["misshape"](encode(REPLY), rng))
    assert reply.terms.shape == (len(REPLY.terms) - 1, REPLY.terms.shape[1])


def test_nonsense_is_well_sealed(rng):
    reasons = set()
    for _ in range(300):
        try:
            decode(RolloutReply, nonsense(encode(REPLY), rng))
        except WireError as error:
            reasons.add(error.reason)
    assert {"field", "range", "shape", "non-finite"} <= reasons
    assert "checksum" not in reasons
