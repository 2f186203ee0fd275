"""Attacks on a run behind keys: none of them reaches the robot, and planning goes on.

One lockstep run goes through all of them. At the end it is the run that nobody disturbed.
"""

import socket
import ssl
import time
from contextlib import ExitStack, suppress

import numpy as np
import pytest

from sumo_dist.authority.certificates import KeysError
from sumo_dist.authority.store import Authority
from sumo_dist.episode.again import repeat
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.codec import encode
from sumo_dist.wire.keys import POOL, topic_key
from sumo_dist.wire.messages import EpisodeEnd, PlanMessage, RolloutReply, Sensors, State
from sumo_dist.wire.notices import CommandMessage, Health
from sumo_dist.wire.session import open_client

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300), pytest.mark.xdist_group("security")]

MARK = "attack"
EMPTY = np.empty(0)


def forged_plan():
    plan = Plan(1, 2, np.full((5, 9), 0.9, np.float32), 0.4, "linear")
    numbers = np.zeros(8), np.ones(8), EMPTY
    return PlanMessage.of(MARK, PlanReport(plan, np.zeros(3), np.ones(3, bool), *numbers, 1.0, 1.0))


FORGED = {
    "plan": forged_plan(),
    "state": State(MARK, 1, np.zeros(64)),
    "sensors": Sensors(MARK, 1, np.zeros(64), *[np.empty(0, int), np.empty((0, 0))],
                       np.empty(0, int), np.empty((0, 0, 7))),
    "end": EpisodeEnd(MARK, 1, "success", success=True, last=True),
    "command": CommandMessage(MARK, 0, MARK, "stop", "", ""),
    "reply": RolloutReply(MARK, "w", MARK, 1, 0, 0, 0, EMPTY.reshape(0, 0), EMPTY.astype(bool),
                          0.0, "no", task_fails=True),
}  # fmt: skip
HEALTH = Health(MARK, "mallory", "worker", {})


@pytest.fixture(autouse=True)
def still_planning(secured):
    """The run goes on after each attack."""
    yield
    if secured.robot.poll() is None:
        secured.goes_on(2)


def tls_socket(secured, port, certificate=None):
    context = ssl.create_default_context(cafile=secured.keys("worker").file("ca.pem"))
    if certificate is not None:
        context.load_cert_chain(certificate / "cert.pem", certificate / "key.pem")
    plain = socket.create_connection(("127.0.0.1", port), 10.0)
    return context.wrap_socket(plain, server_hostname="127.0.0.1")


# Who has no business here


def test_no_certificate(secured, port):
    with tls_socket(secured, port) as stranger:
        stranger.settimeout(10.0)
        with pytest.raises(ssl.SSLError, match="CERTIFICATE_REQUIRED"):
            stranger.recv(1)


def test_no_tls(secured, port):
    with pytest.raises(KeysError, match=rf"wants TLS: dial tls/127\.0\.0\.1:{port} with --keys"):
        open_client(secured.tls.replace("tls/", "tcp/"), 5.0)


def test_a_certificate_of_another_authority(secured, unchecked, tmp_path, eventually):
    other = Authority.found(tmp_path / "other")
    other.host("mallory", ["operator"], [], 1.0)
    mine = secured.authority.home / "authority" / "ca.pem"
    keys = unchecked(other.folder("mallory", "operator"), ca=mine)
    with pytest.raises(KeysError, match="another authority"):
        open_client(secured.tls, 5.0, keys)
    assert eventually(lambda: secured.told("refused a connection", "certificate") >= 1, 20.0)


def test_an_expired_certificate(secured, unchecked):
    secured.authority.host("expired", ["operator"], [], 1e-9)
    keys = unchecked(secured.authority.folder("expired", "operator"))
    with pytest.raises(KeysError, match="it has expired by the router's clock"):
        open_client(secured.tls, 5.0, keys)


def test_a_worker_that_poses_as_the_router(secured, unchecked, tmp_path):
    """Its certificate is good for a client alone, so nobody takes it for a server's."""
    context = ssl.create_default_context(cafile=secured.keys("worker").file("ca.pem"))
    theirs = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    folder = secured.authority.folder("mallory", "worker")
    theirs.load_cert_chain(folder / "cert.pem", folder / "key.pem")
    ours, other = socket.socketpair()
    with ours, other, pytest.raises(ssl.SSLCertVerificationError):
        pair = ssl.MemoryBIO(), ssl.MemoryBIO()
        client = context.wrap_bio(*pair, server_hostname="mallory")
        server = theirs.wrap_bio(*reversed(pair), server_side=True)
        for _ in range(10):
            for side in (client, server):
                with suppress(ssl.SSLWantReadError):
                    side.do_handshake()


# One of us who says what he may not


@pytest.mark.parametrize("role", ["worker", "tracer"])
@pytest.mark.parametrize("what", sorted(FORGED))
def test_what_a_role_may_not_say_reaches_nobody(secured, role, what, eventually):
    message = FORGED[what]
    if role in message.sent_by:
        pytest.skip("it may")
    key = topic_key(POOL if message.pooled else "spot", message.topic, message.address)
    with open_client(secured.tls, 10.0, secured.keys(role)) as session:

        def told():
            session.put(key, encode(message))
            time.sleep(0.02)
            return secured.told("refused", f"{role}.2 from 127.0.0.1:", f"put on {key}") == 1

        assert eventually(told, 20.0)
        # what it may say is heard, so what it said before would have been
        if role == "worker":
            own = topic_key("spot", "health", "mallory")
            session.put(own, encode(HEALTH))
            assert eventually(lambda: own in secured.reached(MARK.encode()), 20.0)
    assert key not in secured.reached(MARK.encode())


@pytest.mark.parametrize("claimed", ["robot", "optimizer", "estimator", "router"])
def test_a_token_of_another_role_is_not_seen(secured, claimed, eventually):
    with (
        Bus.dial(secured.tls, "spot", keys=secured.keys("worker")) as bus,
        Bus.dial(secured.local, "spot") as other,
    ):
        seen = other.watch()
        bus.announce(claimed, "mallory")
        own = bus.announce("worker", "mallory")
        assert eventually(lambda: own in seen.now, 20.0)
        assert not [m for m in seen.now if m.id == "mallory" and m.role != "worker"]
        assert eventually(lambda: secured.told("refused worker.2", f"/{claimed}/mallory/"), 20.0)


def test_a_viewer_hears_no_requests(secured, eventually):
    with open_client(secured.tls, 10.0, secured.keys("tracer")) as session:
        heard = []
        asked = session.declare_subscriber("sumo/*/pool/**", heard.append)
        plans = session.declare_subscriber(topic_key("spot", "plan"), heard.append)
        secured.goes_on()
        assert {str(sample.key_expr).split("/")[-1] for sample in heard} == {"plan"}
        assert eventually(
            lambda: secured.told("tracer.2 from", "declare subscriber on sumo/*/pool/**") == 1, 20.0
        )
        del asked, plans


def test_a_replay_by_who_may_not_speak_reaches_nobody(secured, eventually):
    key, payload = next(pair for pair in secured.heard if pair[0].endswith("/plan"))
    before = secured.heard.count((key, payload))
    told = secured.told("refused tracer.2 from", f"put on {key}")
    with open_client(secured.tls, 10.0, secured.keys("tracer")) as session:
        for _ in range(100):
            session.put(key, payload)
        secured.goes_on()
    assert eventually(
        lambda: secured.told("refused tracer.2 from", f"put on {key}") == told + 1, 20.0
    )
    assert secured.heard.count((key, payload)) == before


def test_a_replay_by_who_may_speak_changes_nothing(secured):
    """It is heard, and the robot has had it: the run's bits at the end say so."""
    old = [pair for pair in secured.heard if pair[0].endswith(("/plan", "/state"))][:40]
    before = [secured.heard.count(pair) for pair in old]
    with ExitStack() as stack:
        role = {"plan": "optimizer", "state": "robot"}
        sessions = {
            end: stack.enter_context(open_client(secured.tls, 10.0, secured.keys(role[end])))
            for end in role
        }
        for key, payload in old:
            sessions[key.rpartition("/")[2]].put(key, payload)
        secured.goes_on()
    assert [secured.heard.count(pair) for pair in old] > before


# Too much


def test_a_hundred_thousand_small_messages(secured):
    with open_client(secured.tls, 10.0, secured.keys("worker")) as session:
        forbidden = session.declare_publisher(topic_key("spot", "command"))
        for i in range(100_000):
            forbidden.put(b"attack %d" % i)
    assert topic_key("spot", "command") not in secured.reached(b"attack ")
    secured.goes_on()


def test_a_hundred_megabytes(secured, eventually):
    key = topic_key(POOL, "reply", "mallory")
    with open_client(secured.tls, 10.0, secured.keys("worker")) as session:
        session.put(key, b"attack-small")
        assert eventually(lambda: key in secured.reached(b"attack-small"), 20.0)
        with suppress(Exception):  # the router may end the session
            session.put(key, b"attack-large" + bytes(100 << 20))
        health = topic_key("spot", "health", "mallory")
        with suppress(Exception):
            session.put(health, b"attack-large" + bytes(1 << 20))  # of a reply it would be allowed
        secured.goes_on()
    assert secured.reached(b"attack-large") == set()


# Who was one of us


def test_a_certificate_that_expires_meanwhile_ends_its_session(secured):
    time.sleep(max(0.0, secured.brief_ends + 3.0 - time.time()))
    assert not any(secured.hears(secured.brief, "brief", "too-late") for _ in range(20))
    assert secured.told("refused a connection", "certificate expired") == 1  # it dials again
    secured.brief.close()


def test_a_revoked_host_is_cut_off_and_the_others_go_on(secured, eventually, tmp_path, unchecked):
    secured.authority.host("gone", ["worker"], [], 1.0)
    stolen = unchecked(secured.authority.folder("gone", "worker"), into=tmp_path / "stolen")
    with Bus.dial(secured.tls, "spot", keys=stolen) as bus:
        assert eventually(lambda: secured.hears(bus, "gone", "before"), 20.0)
        secured.authority.revoke("gone")
        assert eventually(lambda: secured.told("list of revoked keys has changed") == 1, 20.0)
        secured.goes_on()
        assert not any(secured.hears(bus, "gone", "after") for _ in range(20))
    with pytest.raises(KeysError, match=r"does not admit the keys in .*: they were revoked"):
        open_client(secured.tls, 10.0, stolen)
    secured.goes_on()


# What is no protocol. Zenoh takes a tenth of a second for each handshake that fails, one after the
# other, so that these come last: newcomers are kept out for a while.


def test_malformed_bytes_within_tls(secured, port):
    random = np.random.default_rng(3)
    for i in range(30):
        noise = random.bytes(int(random.integers(1, 3000)))
        folder = secured.authority.folder("mallory", "worker")
        with tls_socket(secured, port, folder) as peer, suppress(OSError):
            # a length that is right, one that is not, and none
            peer.sendall(len(noise).to_bytes(2, "little") * (i % 3 != 2) + noise)
    with Bus.dial(secured.tls, "spot", timeout=30.0, keys=secured.keys("worker")):
        pass


def test_malformed_bytes_before_tls(secured, port):
    random = np.random.default_rng(4)
    for i in range(30):
        noise = random.bytes(int(random.integers(1, 3000)))
        with socket.create_connection(("127.0.0.1", port), 10.0) as stranger, suppress(OSError):
            stranger.sendall((b"\x16\x03\x01" if i % 2 else b"") + noise)
    with Bus.dial(secured.tls, "spot", timeout=60.0, keys=secured.keys("worker")):
        pass


def test_a_thousand_connections(secured, port):
    """Nobody who is there notices, and who is on the router's machine can still come."""
    with ExitStack() as stack:
        for i in range(1000):
            with suppress(OSError):
                one = socket.create_connection(("127.0.0.1", port), 2.0)
                stack.callback(one.close)
                if i % 2:
                    one.sendall(b"\x16\x03\x01")  # the beginning of a handshake, and no more
        secured.goes_on()
        with Bus.dial(secured.local, "spot", timeout=20.0):
            pass


# In the end


def test_nothing_of_it_has_reached_the_robot(secured):
    assert secured.robot.poll() is None
    recording = secured.end()
    assert recording.plan_numbers[-1] > 50
    again = repeat(recording)
    assert again.plan_digest == recording.plan_digest
    assert again.state_digest == recording.state_digest
