"""What a client is told where keys are wrong: one line that says whose, and the way out."""

import shutil
import threading
import time
from datetime import UTC, datetime, timedelta

import pytest

from sumo_dist.authority.certificates import KeysError, read_certificate
from sumo_dist.authority.folder import KeyFolder
from sumo_dist.authority.store import Authority
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.services import router
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.connection import keys_for
from sumo_dist.wire.finding import Search
from sumo_dist.wire.session import open_client, open_router


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    made = Authority.found(tmp_path_factory.mktemp("keys"))
    made.host("here", ["router", "worker", "operator"], [], 1.0)
    return made


@pytest.fixture(scope="module")
def secure(authority, free_endpoint):
    """A router with keys; its TLS endpoint."""
    endpoint = free_endpoint().replace("tcp/", "tls/")
    keys = KeyFolder.read(authority.folder("here", "router"), ("router",))
    with open_router(endpoint, keys=keys):
        yield endpoint


@pytest.fixture
def worker(authority):
    return KeyFolder.read(authority.folder("here", "worker"), ("worker",))


def test_who_has_keys_is_let_in(secure, worker):
    for name in ("127.0.0.1", "localhost"):
        Bus.dial(secure.replace("127.0.0.1", name), "spot", keys=worker).close()


def test_the_same_in_clear_names_the_endpoint_and_the_option(secure):
    with pytest.raises(KeysError, match=r"wants TLS: dial tls/127\.0\.0\.1:\d+ with --keys DIR"):
        Bus.dial(secure.replace("tls/", "tcp/"), "spot")


def test_no_keys_is_wrong_usage(secure):
    with pytest.raises(UsageError, match="needs --keys DIR, a folder that `sumo-dist keys host`"):
        Bus.dial(secure, "spot")


def test_tls_to_a_router_without_it(router, worker):
    with pytest.raises(SumoError, match=r"does not speak TLS|no router at"):
        open_client(router.replace("tcp/", "tls/"), 2.0, worker)


def test_nobody_there_is_no_matter_of_keys(free_endpoint, worker):
    with pytest.raises(SumoError, match="no router at tls/") as caught:
        open_client(free_endpoint().replace("tcp/", "tls/"), 0.5, worker)
    assert not isinstance(caught.value, KeysError)


def test_a_router_of_another_authority_is_named(secure, tmp_path):
    other = Authority.found(tmp_path)
    other.host("there", ["worker"], [], 1.0)
    keys = KeyFolder.read(other.folder("there", "worker"))
    with pytest.raises(KeysError, match=r"router at 127\.0\.0\.1:\d+ is not of the authority of"):
        open_client(secure, 5.0, keys)


def test_a_router_by_a_name_that_it_has_not_is_named(authority, secure, worker):
    endpoint = secure.replace("127.0.0.1", "127.0.0.3")
    keys = KeyFolder.read(authority.folder("here", "router"))
    with (
        open_router(endpoint, keys=keys),
        pytest.raises(KeysError, match=r"does not name 127\.0\.0\.3: dial it by .* --address"),
    ):
        open_client(endpoint, 5.0, worker)


def test_a_router_whose_certificate_has_expired_is_named(
    authority, free_endpoint, worker, eventually
):
    authority.host("old", ["router"], [], 1e-9)
    folder = authority.folder("old", "router")
    certificate = read_certificate(folder / "cert.pem")
    over = certificate.expires + timedelta(seconds=1)  # it holds through the second that it names
    assert eventually(lambda: datetime.now(UTC) >= over, 2.0)
    keys = KeyFolder(folder, certificate)  # as one that runs on and on
    endpoint = free_endpoint().replace("tcp/", "tls/")
    with (
        open_router(endpoint, keys=keys),
        pytest.raises(KeysError, match="has expired: `sumo-dist keys renew` its host"),
    ):
        open_client(endpoint, 5.0, worker)


def test_keys_of_another_role_are_refused_before_anybody_is_dialled(authority):
    with pytest.raises(KeysError, match="is for the role worker; needed here: robot"):
        keys_for("tls/192.0.2.1:7447", authority.folder("here", "worker"), "robot")


def test_loopback_makes_no_use_of_keys(tmp_path):
    assert keys_for("tcp/127.0.0.1:7447", tmp_path / "none", "robot") is None


def test_who_looks_for_a_robot_is_told_too(secure):
    with pytest.raises(UsageError, match="needs --keys DIR"):
        Search(secure).look()
    with pytest.raises(KeysError, match="wants TLS"):
        Search(secure.replace("tls/", "tcp/")).look()


def test_a_local_endpoint_beside_it_needs_none(authority, free_endpoint, worker, eventually):
    """And who is revoked meanwhile is cut off, while the others come back by themselves."""
    local, outside = free_endpoint(), free_endpoint().replace("tcp/", "tls/")
    authority.host("gone", ["worker"], [], 1.0)
    folder = authority.home / "stolen"
    shutil.copytree(authority.folder("gone", "worker"), folder)
    options = router.RouterOptions(outside, local, authority.folder("here", "router"))
    stop = threading.Event()
    serving = threading.Thread(target=router.serve, args=[options, stop])
    serving.start()
    try:
        stolen = KeyFolder.read(folder)
        with (
            Bus.dial(local, "spot") as here,
            Bus.dial(outside, "spot", keys=worker) as other,
            Bus.dial(outside, "spot", keys=stolen) as thief,
        ):
            seen = here.watch("worker")
            member, bad = other.announce("worker", "w-1"), thief.announce("worker", "w-2")
            assert eventually(lambda: seen.now == {member, bad}, 20.0)
            authority.revoke("gone")
            assert eventually(lambda: bad not in seen.now, 20.0)
            time.sleep(1.0)  # all dial again meanwhile
            assert eventually(lambda: seen.now == {member}, 20.0)
        with pytest.raises(KeysError, match=r"does not admit the keys in .*stolen: they were rev"):
            open_client(outside, 10.0, stolen)
    finally:
        stop.set()
        serving.join(10.0)
