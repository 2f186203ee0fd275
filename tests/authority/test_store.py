import json
import os
import stat
import threading
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from sumo_dist.authority import store
from sumo_dist.authority.certificates import KeysError, is_issued_by, read_certificate, read_key
from sumo_dist.authority.folder import KeyFolder
from sumo_dist.authority.store import Authority, home_of, read_revoked


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_only_its_user_can_read_what_is_written(authority):
    old = os.umask(0)
    try:
        authority.host("r-2", ["worker"], [], 1.0)
    finally:
        os.umask(old)
    for path in [authority.home, *authority.home.rglob("*")]:
        expected = 0o700 if path.is_dir() else 0o600
        assert stat.S_IMODE(path.stat().st_mode) == expected, path


@pytest.mark.parametrize("role", ["router", "robot", "optimizer", "worker", "tracer", "operator"])
def test_a_host_gets_a_folder_a_role_that_belongs_together(authority, role):
    folder = KeyFolder.read(authority.folder("r-1", role), (role,))
    assert (folder.certificate.role, folder.certificate.number) == (role, 1)
    assert folder.certificate.host == "r-1"
    left = folder.certificate.expires - datetime.now(UTC)
    assert timedelta(days=29.9) < left < timedelta(days=30.1)
    usage = folder.certificate.source.extensions.get_extension_for_class(x509.ExtendedKeyUsage)
    expected = "SERVER_AUTH" if role == "router" else "CLIENT_AUTH"
    assert list(usage.value) == [getattr(ExtendedKeyUsageOID, expected)]
    names = {path.name for path in folder.path.iterdir()}
    assert names == {"ca.pem", "cert.pem", "key.pem"} | ({"revoked.json"} & names)
    assert ("revoked.json" in names) == (role == "router")


def test_a_router_is_named_by_its_addresses_its_host_and_loopback(authority):
    found = read_certificate(authority.folder("r-1", "router") / "cert.pem").source
    names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert set(names.get_values_for_type(x509.DNSName)) == {"r-1", "localhost"}
    addresses = map(str, names.get_values_for_type(x509.IPAddress))
    assert set(addresses) == {"192.0.2.1", "127.0.0.1", "::1"}


def test_nothing_is_overwritten(authority):
    before = contents(authority.home)
    with pytest.raises(KeysError, match=r"is there already: it is kept"):
        Authority.found(authority.home)
    with pytest.raises(KeysError, match=r"r-1 has keys for worker in .*`sumo-dist keys renew r-1`"):
        authority.host("r-1", ["worker"], [], 1.0)
    assert contents(authority.home) == before


def test_an_authority_that_is_not_there_names_the_way_out(tmp_path):
    with pytest.raises(KeysError, match=r"no authority in .*: make one with `sumo-dist keys init`"):
        Authority(tmp_path)


def test_two_authorities_do_not_vouch_for_each_other(authority, tmp_path):
    other = Authority.found(tmp_path / "other")
    other.host("r-1", ["worker"], [], 1.0)
    foreign = read_certificate(other.folder("r-1", "worker") / "cert.pem")
    assert is_issued_by(foreign, other.ca)
    assert not is_issued_by(foreign, authority.ca)


def test_renewing_keeps_the_key_and_counts_on(authority):
    folder = authority.folder("r-1", "worker")
    key = read_key(folder / "key.pem").private_numbers()
    assert set(authority.renew("r-1", 60.0)) == {one.role for one in authority.issued()}
    renewed = KeyFolder.read(folder, ("worker",)).certificate
    assert read_key(folder / "key.pem").private_numbers() == key
    assert renewed.number == 2
    assert renewed.expires > datetime.now(UTC) + timedelta(days=59)
    with pytest.raises(KeysError, match=r"r-9 has no valid keys here; those that have: r-1"):
        authority.renew("r-9", 1.0)


def test_revoking_ends_renewed_ones_too_and_tells_every_router(authority):
    authority.host("r-2", ["router"], [], 1.0)
    authority.host("w-1", ["worker", "optimizer"], [], 1.0)
    authority.renew("w-1", 2.0)
    assert authority.revoke("w-1", ["worker"]) == ["r-1", "r-2"]
    for router in ("r-1", "r-2"):
        assert read_revoked(authority.folder(router, "router")) == {"worker.2", "worker.3"}
    assert not authority.folder("w-1", "worker").exists()
    assert authority.folder("w-1", "optimizer").exists()
    authority.host("w-1", ["worker"], [], 1.0)  # a new certificate, which is not revoked
    assert KeyFolder.read(authority.folder("w-1", "worker")).certificate.number == 4
    authority.host("r-3", ["router"], [], 1.0)  # knows of it from the start
    assert read_revoked(authority.folder("r-3", "router")) == {"worker.2", "worker.3"}
    with pytest.raises(KeysError, match="nothing to revoke"):
        authority.revoke("w-9")


def test_two_at_once_issue_different_numbers(authority):
    def issue(name):
        Authority(authority.home).host(name, ["worker"], [], 1.0)

    threads = [threading.Thread(target=issue, args=[f"w-{i}"]) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    numbers = [one.number for one in authority.issued() if one.role == "worker"]
    assert sorted(numbers) == list(range(1, 10))


def test_when_the_numbers_are_used_up_it_says_so(authority, monkeypatch):
    monkeypatch.setattr(store, "NUMBERS", 1)
    with pytest.raises(KeysError, match="this authority has issued 1 certificates of worker"):
        authority.host("w-1", ["worker"], [], 1.0)
    assert not authority.folder("w-1", "worker").exists()


def test_it_does_not_issue_beyond_its_own_end(authority):
    with pytest.raises(KeysError, match="the authority itself ends on"):
        authority.host("w-1", ["worker"], [], 3650.0)


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"a": 1}'])
def test_a_damaged_record_or_list_is_one_line(authority, text):
    folder = authority.folder("r-1", "router")
    (folder / "revoked.json").write_text(text)
    with pytest.raises(KeysError, match=r"revoked\.json is damaged: copy it again"):
        read_revoked(folder)
    (authority.home / "authority" / "issued.json").write_text(text)
    with pytest.raises(KeysError, match=r"issued\.json is damaged"):
        authority.issued()


def test_a_router_without_its_list_does_not_start(authority):
    (authority.folder("r-1", "router") / "revoked.json").unlink()
    with pytest.raises(KeysError, match=r"cannot read .*revoked\.json"):
        read_revoked(authority.folder("r-1", "router"))


def test_a_failed_issue_leaves_no_half_of_a_folder(authority, monkeypatch):
    write = store._write

    def fails(path, content):
        if path.name == "key.pem":
            raise OSError(28, "No space left on device", str(path))
        write(path, content)

    monkeypatch.setattr(store, "_write", fails)
    with pytest.raises(KeysError, match=r"cannot write .*No space left"):
        authority.host("w-1", ["worker"], [], 1.0)
    monkeypatch.undo()
    assert not list((authority.home / "hosts" / "w-1").iterdir())
    authority.host("w-1", ["worker"], [], 1.0)
    json.loads((authority.home / "authority" / "issued.json").read_text())


def test_the_home_is_given_or_in_the_environment_or_the_usual_one(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.delenv("SUMO_DIST_KEYS", raising=False)
    assert home_of(None) == tmp_path / ".config" / "sumo-dist" / "keys"
    monkeypatch.setenv("SUMO_DIST_KEYS", str(tmp_path / "keys"))
    assert home_of(None) == tmp_path / "keys"
    assert home_of(tmp_path / "given") == tmp_path / "given"
