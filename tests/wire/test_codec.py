import hashlib
import pickle
import timeit
import tracemalloc
from dataclasses import asdict, fields, replace

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.wire.codec import Template, decode, encode, seal, unseal
from sumo_dist.wire.keys import SCHEMA
from sumo_dist.wire.messages import (
    EpisodeEnd,
    EpisodeInfo,
    Message,
    NoPlan,
    PlanMessage,
    Question,
    RolloutReply,
    RolloutRequest,
    Sensors,
    State,
    Traces,
)
from sumo_dist.wire.notices import (
    Ack,
    CommandMessage,
    Drain,
    Event,
    Health,
    TrialReply,
    TrialRequest,
    WorkerHealth,
    WorkerStatus,
)
from sumo_dist.wire.schema import MAX_BYTES, WireError, record

RNG = np.random.default_rng(0)
RUN = "run-7"
PLAN = Plan(4, 10, RNG.standard_normal((4, 9)).astype(np.float32), 1.5, "linear")
NO_STAMPS = np.zeros(0, np.int64)
SETTINGS = asdict(PlannerConfig())

MESSAGES = [
    Sensors(RUN, 3, RNG.random(51), NO_STAMPS, np.zeros((0, 38)), NO_STAMPS, np.zeros((0, 2, 7))),
    Sensors(
        RUN, 3, np.zeros(0), np.array([3, 6]), RNG.random((2, 38)),
        np.array([8]), RNG.random((1, 2, 7)),
    ),
    NoPlan(RUN, "cost term 'mine': mine.py, line 3: ZeroDivisionError: division by zero"),
    State(RUN, 3, RNG.random(51)),
    Question(
        RUN, 0, 0, "lockstep", 1.0, RNG.random(51), np.zeros(25, np.float32), None,
        RNG.random(6), RNG.random(4), SETTINGS,
    ),
    Question(
        RUN, -1, 12, "realtime", 0.4, RNG.random(51), np.zeros(0, np.float32), PLAN,
        RNG.random(6), np.zeros(0), SETTINGS,
    ),
    PlanMessage(
        RUN, PLAN, RNG.random(32), RNG.random(32) > 0.5, RNG.random(6), RNG.random(6),
        RNG.random(4), 31.5, 2.25, 2, 0, 4, 1, False, 2,
    ),
    RolloutRequest(
        RUN, "w-1", "o-1", "spot", 4, 0, 1, 16, "spot/move_box", "ab12", "native-avx2", SETTINGS,
        RNG.random(51), np.zeros(25, np.float32), RNG.random(4),
        RNG.random((16, 4, 9)).astype(np.float32), 40.0,
    ),
    RolloutReply(
        RUN, "w-1", "o-1", 4, 0, 1, 16, RNG.random((16, 6)), np.ones(16, bool), 30.0, "", False
    ),
    RolloutReply(
        RUN, "w-1", "o-1", 4, 0, 1, 16, np.zeros((0, 0)), np.zeros(0, bool), 0.0, "other task", True
    ),
    Traces(RUN, "w-1", "spot", 4, 0, 16, RNG.random((16, 2, 25, 3)).astype(np.float32)),
    Event(RUN, "optimizer", "warning", "no workers: keeping the plan"),
    EpisodeEnd(RUN, 700, "success", True, False),
    TrialRequest(RUN, "w-1.0", 4, "planned", '{"task": "spot/move_box", "seed": 3}'),
    TrialReply(RUN, "w-1.0", 4, '{"task": "spot/move_box"}', ""),
    Drain("", "w-1", "somebody"),
    CommandMessage(RUN, 3, "somebody", "weight", "goal", "80"),
    Ack(RUN, 3, "somebody", 120, "unknown cost term"),
    EpisodeInfo(RUN, '{"task": "spot/move_box"}', "ab12", 2),
    Health(RUN, "robot", "running", {"tick": 7, "load": 0.5, "build": "x"}),
    WorkerHealth.of(
        RUN, "o-1",
        [WorkerStatus("w-1", "answers", 310.0, 4, 0.25), WorkerStatus("w-2", "", 0.0, 0, -1.0)],
    ),
]  # fmt: skip
STATE = next(m for m in MESSAGES if isinstance(m, State))
REQUEST = next(m for m in MESSAGES if isinstance(m, RolloutRequest))
REPLY = next(m for m in MESSAGES if isinstance(m, RolloutReply))
SENSORS, QUESTION, END, COMMAND, ACK, INFO, HEALTH, WORKER = (
    next(m for m in MESSAGES if isinstance(m, kind))
    for kind in (
        *(Sensors, Question, EpisodeEnd, CommandMessage),
        *(Ack, EpisodeInfo, Health, WorkerHealth),
    )
)
KINDS = sorted({type(m) for m in MESSAGES}, key=lambda kind: kind.__name__)


def assert_equal(sent, received):
    assert type(sent) is type(received)
    for field in fields(sent):
        one, other = getattr(sent, field.name), getattr(received, field.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype and one.shape == other.shape
            assert one.tobytes() == other.tobytes()
        elif isinstance(one, Plan):
            assert_equal(one, other)
        else:
            assert one == other and type(one) is type(other)


def tampered(message: Message, **changes) -> bytes:
    """Encode a message and change some of its raw fields."""
    return seal(msgpack.packb({**msgpack.unpackb(unseal(encode(message))), **changes}))


def reason_of(kind: type[Message], payload: bytes) -> str:
    with pytest.raises(WireError) as caught:
        decode(kind, payload)
    return caught.value.reason


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_messages_survive_bit_for_bit(message):
    assert_equal(message, decode(type(message), encode(message)))


def test_what_a_template_encodes_is_what_its_messages_would_be():
    own = ("worker", "shard", "knots", "priority")
    template = Template(REQUEST, own)
    for shard, worker in enumerate(("w-1", "w-2")):
        message = replace(
            REQUEST, worker=worker, shard=shard, knots=REQUEST.knots[shard : shard + 3]
        )
        payload = template.encode(**{name: getattr(message, name) for name in own})
        assert_equal(message, decode(RolloutRequest, payload))
    with pytest.raises(WireError, match="knots"):
        template.encode(
            worker="w", shard=0, knots=np.full((1, 4, 9), np.nan, np.float32), priority=0
        )


def test_texts_with_line_breaks_are_not_lines():
    with pytest.raises(WireError, match="line break"):
        encode(replace(WORKER, states=("answers", "one\ntwo")))


def test_decoded_arrays_are_read_only_and_aligned():
    knots = decode(RolloutRequest, encode(REQUEST)).knots
    assert not knots.flags.writeable
    assert knots.flags.aligned and knots.flags.c_contiguous


def test_every_message_type_is_covered():
    assert set(KINDS) == set(Message.__subclasses__())


def test_a_changed_layout_needs_a_new_schema_version():
    layout = "\n".join(repr(record(kind)) for kind in KINDS)
    digest = hashlib.sha256(layout.encode()).hexdigest()[:16]
    assert (SCHEMA, digest) == (7, "5ded6b52d61d09da"), (
        "raise keys.SCHEMA, then pin the new layout here"
    )


def test_numpy_scalars_and_views_are_sent_as_plain_values():
    state = np.arange(102.0)[::2]
    received = decode(State, encode(State(RUN, np.int64(3), state)))
    assert type(received.tick) is int
    np.testing.assert_array_equal(received.state, state)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"v": SCHEMA + 1}, "version"),
        ({"v": None}, "version"),
        ({"type": "Question"}, "type"),
        ({"extra": 1}, "field"),
        ({"tick": "3"}, "field"),
        ({"tick": True}, "field"),
        ({"tick": -1}, "range"),
        ({"tick": 2**63}, "range"),
        ({"run": 7}, "field"),
        ({"run": "x" * 201}, "size"),
        ({"state": [0.0]}, "field"),
        ({"state": ["f4", [1], b"\0" * 4]}, "dtype"),
        ({"state": ["f8", [2], b"\0" * 8]}, "shape"),
        ({"state": ["f8", [-1], b"\0" * 8]}, "shape"),
        ({"state": ["f8", [1, 1], b"\0" * 8]}, "shape"),
        ({"state": ["f8", [0], b""]}, "shape"),
        ({"state": ["f8", [1.0], b"\0" * 8]}, "shape"),
        ({"state": ["f8", [1], np.array(np.nan).tobytes()]}, "non-finite"),
        ({"state": ["f8", [1], np.array(-np.inf).tobytes()]}, "non-finite"),
    ],
)
def test_bad_fields_have_named_reasons(changes, reason):
    assert reason_of(State, tampered(STATE, **changes)) == reason


@pytest.mark.parametrize(
    ("message", "changes", "reason"),
    [
        (REQUEST, {"worker": "w/1"}, "range"),
        (REQUEST, {"settings": {"horizon": float("nan")}}, "non-finite"),
        (REQUEST, {"settings": {"horizon": [1]}}, "field"),
        (REQUEST, {"settings": [1]}, "field"),
        (REQUEST, {"reply_budget_ms": float("inf")}, "non-finite"),
        (REQUEST, {"reply_budget_ms": -1.0}, "range"),
        (REQUEST, {"reply_budget_ms": 1}, "field"),
        (REPLY, {"valid": ["b1", [2], b"\0\1"]}, "shape"),
        (REPLY, {"valid": ["b1", [16], b"\0\2" * 8]}, "range"),
        (SENSORS, {"mocap": ["f8", [0, 2, 8], b""]}, "shape"),
        (SENSORS, {"mocap": ["f8", [0, 2**62, 7], b""]}, "shape"),
        (QUESTION, {"clock": "sundial"}, "range"),
        (QUESTION, {"followed": {"number": 1}}, "field"),
        (QUESTION, {"number": -2}, "range"),
        (QUESTION, {"speed": 1e300}, "range"),
        (QUESTION, {"speed": -0.5}, "range"),
        (QUESTION, {"state": ["f8", [0], b""]}, "shape"),
        (QUESTION, {"weights": ["f8", [1], np.array(np.nan).tobytes()]}, "non-finite"),
        (QUESTION, {"parameters": ["f8", [1], np.array(np.inf).tobytes()]}, "non-finite"),
        (QUESTION, {"settings": {"horizon": None}}, "field"),
        (END, {"success": 1}, "field"),
        (END, {"last": 0}, "field"),
        (COMMAND, {"verb": "dance"}, "range"),
        (COMMAND, {"sender": "some body"}, "range"),
        (COMMAND, {"number": -1}, "range"),
        (COMMAND, {"value": "x" * 501}, "size"),
        (ACK, {"refusal": "x" * 1001}, "size"),
        (INFO, {"config": "x" * 20_001}, "size"),
        (INFO, {"task_hash": "x" * 65}, "size"),
        (INFO, {"number": -1}, "range"),
        (HEALTH, {"counters": {"tick": None}}, "field"),
        (WORKER, {"workers": "w-1\nnot a name"}, "range"),
        (WORKER, {"states": "answers"}, "shape"),
    ],
)
def test_rules_of_other_messages(message, changes, reason):
    assert reason_of(type(message), tampered(message, **changes)) == reason


def test_missing_field_and_nested_field_are_named():
    body = msgpack.unpackb(unseal(encode(STATE)))
    del body["tick"]
    with pytest.raises(WireError, match="field: needs run, tick, state"):
        decode(State, seal(msgpack.packb(body)))
    followed = next(m for m in MESSAGES if isinstance(m, Question) and m.followed)
    nested = msgpack.unpackb(unseal(encode(followed)))
    nested["followed"]["knots"][2] = b"\xff" * (4 * 36)
    with pytest.raises(WireError, match="non-finite: followed: knots"):
        decode(Question, seal(msgpack.packb(nested)))


@pytest.mark.parametrize(
    "payload", [b"", b"\x80", b"\xc1", b"\xa3abc", b"\x00\x00", b"\xd6\xff\0\0\0\0"]
)
def test_what_is_no_message_is_rejected(payload):
    assert reason_of(State, seal(payload)) in ("malformed", "version", "checksum")
    assert reason_of(State, payload) == "checksum"


def test_sizes_are_bounded_before_memory_is_spent():
    assert reason_of(State, bytes(MAX_BYTES + 5)) == "size"
    nested = b"\xdd\x00\x10\x00\x00" * 500 + bytes(1 << 20)  # lists of a million, 500 deep
    tracemalloc.start()
    assert reason_of(State, seal(nested)) == "malformed"
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MAX_BYTES
    with pytest.raises(WireError, match="size"):
        encode(State(RUN, 0, np.zeros(MAX_BYTES // 8)))


@pytest.mark.parametrize(
    ("message", "match"),
    [
        (State(RUN, 0, np.array([np.nan])), "non-finite: state"),
        (State(RUN, 0, np.zeros(3, np.float32)), "dtype: state: needs float64, got float32"),
        (State(RUN, 0, [0.0]), "dtype: state: needs float64, got list"),
        (State(RUN, 1.5, np.zeros(3)), "field: tick"),
        (State("\ud800", 0, np.zeros(3)), "field"),
        (replace(REPLY, valid=np.ones(3, bool)), "shape: valid"),
        (replace(REQUEST, settings={"nodes": None}), "field: settings"),
    ],
)
def test_nothing_is_sent_that_would_be_rejected(message, match):
    with pytest.raises(WireError, match=match):
        encode(message)


def accepted_means_valid(kind: type[Message], payload: bytes) -> None:
    """Decoding raises WireError or yields a message that can be sent again."""
    try:
        message = decode(kind, seal(payload))
    except WireError as error:
        assert error.reason and error.detail
    else:
        assert_equal(message, decode(kind, encode(message)))


FUZZ = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@FUZZ
@given(kind=st.sampled_from(KINDS), payload=st.binary(max_size=300))
def test_arbitrary_bytes_never_crash(kind, payload):
    accepted_means_valid(kind, payload)


@FUZZ
@given(message=st.sampled_from(MESSAGES), data=st.data())
def test_mutated_messages_never_crash(message, data):
    payload = bytearray(unseal(encode(message)))
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(payload)))
        end = min(len(payload), start + data.draw(st.integers(0, 8)))
        payload[start:end] = data.draw(st.binary(max_size=8))
    accepted_means_valid(type(message), bytes(payload))


@FUZZ
@given(message=st.sampled_from(MESSAGES), data=st.data())
def test_truncated_messages_are_malformed(message, data):
    payload = encode(message)
    end = data.draw(st.integers(0, len(payload) - 1))
    assert reason_of(type(message), payload[:end]) == "checksum"
    packed = unseal(payload)[: max(1, end - 4)]
    assert reason_of(type(message), seal(packed)) == "malformed"


@FUZZ
@given(message=st.sampled_from(MESSAGES), data=st.data())
def test_a_flipped_bit_anywhere_is_noticed(message, data):
    payload = bytearray(encode(message))
    payload[data.draw(st.integers(0, len(payload) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    assert reason_of(type(message), bytes(payload)) == "checksum"


RAW = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text()
    | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4)
    ),
    max_leaves=8,
)


@FUZZ
@given(message=st.sampled_from(MESSAGES), raw=RAW, data=st.data())
def test_any_value_in_any_field_never_crashes(message, raw, data):
    field = data.draw(st.sampled_from([f.name for f in fields(message)]))
    accepted_means_valid(type(message), unseal(tampered(message, **{field: raw})))


def test_health_of_many_counters_can_be_decoded():
    """As many as settings may have; what grows with the workers has messages of its own."""
    counters = {f"a counter of a rather long name {i}": i for i in range(40)}
    message = Health(RUN, "optimizer", "realtime", counters)
    assert decode(Health, encode(message)).counters == counters


def test_a_command_travels_whole():
    command = decode(CommandMessage, encode(COMMAND)).command
    assert (command.number, command.sender, command.verb) == (3, "somebody", "weight")
    assert (command.name, command.value) == ("goal", "80")


@pytest.mark.alone
def test_a_request_costs_a_few_times_what_pickle_takes():
    """Which checks nothing; both depend alike on the machine."""
    payload, pickled = encode(REQUEST), pickle.dumps(REQUEST)

    def best(call) -> float:
        return min(timeit.repeat(call, number=20, repeat=20))

    ours = best(lambda: encode(REQUEST)) + best(lambda: decode(RolloutRequest, payload))
    theirs = best(lambda: pickle.dumps(REQUEST)) + best(lambda: pickle.loads(pickled))
    assert ours < 5 * theirs  # 2.8 times, alone and under load
