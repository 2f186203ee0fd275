"""`sumo-dist keys` from the command line, and what `doctor` says of what it has issued."""

import re

import pytest

from sumo_dist.authority.store import Authority
from sumo_dist.cli import main
from sumo_dist.commands import doctor


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Folder of keys in which nothing is yet."""
    monkeypatch.setenv("SUMO_DIST_KEYS", str(tmp_path / "keys"))
    return tmp_path / "keys"


@pytest.fixture
def keys(home, capsys):
    """Return a function that runs `keys` and returns its exit code and what it has said."""

    def keys(*words):
        code = main(["keys", *words])
        return code, "".join(capsys.readouterr())

    return keys


def test_from_an_authority_to_a_revoked_host(home, keys):
    code, said = keys("init")
    assert code == 0
    assert said.startswith(f"an authority in {home}, until 20")
    at = ("--address", "192.0.2.1", "r-1.lab")
    code, said = keys("host", "r-1", "--role", "router,robot", *at)
    assert (code, said.splitlines()) == (
        0,
        [f"{home}/hosts/r-1/{role}: copy it to r-1, for --keys" for role in ("router", "robot")],
    )
    assert keys("host", "w-1", "--role", "worker", "--days", "3")[0] == 0
    assert state_of(keys, "w-1") == ["w-1", "worker", "worker.1", "2 days left, renew it"]

    code, said = keys("renew", "w-1")
    assert code == 0
    assert said == f"{home}/hosts/w-1/worker: copy its cert.pem to w-1 and start its worker again\n"
    assert state_of(keys, "w-1") == ["w-1", "worker", "worker.2", "89 days left"]
    assert state_of(keys, "r-1") == [
        "r-1",
        "router",
        "router.1",
        "89 days left",
        "192.0.2.1",
        "r-1.lab",
    ]

    code, said = keys("revoke", "w-1")
    assert code == 0
    assert said.startswith(f"{home}/hosts/r-1/router/revoked.json: copy it to the router's folder")
    assert state_of(keys, "w-1") == ["w-1", "worker", "worker.2", "revoked"]
    assert not (home / "hosts" / "w-1").exists()


def state_of(keys, host):
    """What `show` says of the newest certificate of a host: host, role, name, state, addresses."""
    code, said = keys("show")
    assert code == 0
    row = [line for line in said.splitlines() if line.split()[0] == host][-1]
    host, role, name, _day, _time, rest = row.split(maxsplit=5)
    state, *addresses = rest.split("  ")
    return [host, role, name, state, *(a for text in addresses for a in text.split(", "))]


def test_one_authority_of_several_is_named(home, keys, tmp_path):
    other = tmp_path / "other"
    assert keys("init", "--home", str(other))[0] == 0
    assert keys("host", "w-1", "--role", "worker", "--home", str(other))[0] == 0
    assert (other / "hosts" / "w-1" / "worker" / "key.pem").exists()
    assert not home.exists()


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["host", "w-1", "--role", "worker"], 3, "no authority in .*: make one with `sumo-dist ke"),
        (["show"], 3, "no authority in .*: make one with `sumo-dist keys init`"),
        (["renew", "w-1"], 3, "no authority in "),
        (["revoke", "w-1"], 3, "no authority in "),
        (["host", "w/1", "--role", "worker"], 2, "host 'w/1' is not a valid name: up to 50 of A-Z"),
        (["renew", "w 1"], 2, "host 'w 1' is not a valid name"),
        (["revoke", ".."], 2, "host '..' is not a valid name"),
        (["host", "w-1", "--role", "worker", "--days", "0"], 2, "days must be in "),
        (["renew", "w-1", "--days", "nan"], 2, "days must be in .0, 3650., got nan"),
        (["host", "w-1", "--role", "worker", "--address", "a b"], 2, "'a b' is "),
        (["host", "w-1"], 2, "--role"),
        (["host", "--role", "worker"], 2, "HOST|STR|required"),
    ],
)
def test_wrong_usage_is_told_and_writes_nothing(home, keys, words, code, message):
    found, said = keys(*words)
    assert re.search(message, said), said
    assert found == code
    assert not home.exists()


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["init"], 3, "is there already: it is kept, and so is what it has issued"),
        (["host", "w-2", "--role", "work"], 2, "unknown role 'work'; valid: "),
        (["host", "w-2", "--role", ""], 2, "unknown role ''; valid: "),
        (["host", "w-2", "--role", "worker,"], 2, "unknown role ''; valid: "),
        (["revoke", "w-1", "--role", "robots"], 2, "unknown role 'robots'; valid: "),
        (["host", "w-1", "--role", "worker"], 3, "w-1 has keys for worker in .*renew w-1"),
        (["renew", "w-9"], 3, "w-9 has no valid keys here; those that have: w-1"),
        (["revoke", "w-9"], 3, "nothing to revoke: w-9 has no valid keys here; .*: w-1"),
        (["revoke", "w-1", "--role", "robot"], 3, "nothing to revoke: "),
    ],
)
def test_what_an_authority_refuses_leaves_it_as_it_was(home, keys, words, code, message):
    Authority.found(home).host("w-1", ["worker"], [], 30.0)
    before = {path: path.read_bytes() for path in home.rglob("*") if path.is_file()}
    found, said = keys(*words)
    assert re.search(message, said), said
    assert (found, said.count("\n")) == (code, 1)
    assert {path: path.read_bytes() for path in home.rglob("*") if path.is_file()} == before


# What `doctor` says


@pytest.fixture
def authority(home):
    """One that has issued keys for a host, good for long."""
    made = Authority.found(home)
    made.host("r-1", ["router", "robot"], [], 90.0)
    return made


def found():
    return (finding := doctor.examine(doctor.keys)).level, finding.text


def test_doctor_counts_what_is_good_and_names_what_ends_first(home, authority):
    authority.host("w-1", ["worker"], [], 60.0)
    authority.host("w-2", ["worker"], [], 5.0)
    authority.renew("w-2", 80.0)  # what it was before counts no more
    authority.host("w-3", ["worker"], [], 5.0)
    authority.revoke("w-3")
    level, text = found()
    assert level == "ok"
    assert re.fullmatch(
        rf"4 certificates of {home}: w-1's worker ends first, on 20\d\d-\d\d-\d\d", text
    )


def test_doctor_warns_of_what_ends_soon_and_of_what_has_ended(authority):
    authority.host("w-1", ["worker"], [], 3.0)
    level, text = found()
    assert level == "warn"
    assert re.search(r"w-1's worker ends first, on .*: `sumo-dist keys renew HOST`$", text)
    authority.host("w-2", ["worker", "tracer"], [], 1e-9)
    hint = "`sumo-dist keys renew HOST`, or `revoke` what is not used"
    assert found() == ("warn", f"expired: w-2's tracer, w-2's worker; {hint}")
    authority.revoke("w-1")
    authority.renew("w-2", 90.0)
    assert found()[0] == "ok"


@pytest.mark.parametrize("path", ["authority/ca.key", "hosts/r-1/robot/key.pem"])
@pytest.mark.parametrize("mode", [0o640, 0o604, 0o622])
def test_doctor_warns_of_a_private_key_that_others_may_read(home, authority, path, mode):
    (home / path).chmod(mode)
    level, text = found()
    assert level == "warn"
    assert text == f"others may read or change {home / path}: chmod 600"


def test_doctor_has_nothing_to_say_without_an_authority_and_fails_on_a_damaged_one(home, keys):
    assert found() == (
        "ok",
        f"no authority in {home}: only what leaves this machine needs keys",
    )
    Authority.found(home)
    (home / "authority" / "issued.json").write_text("[{}]")
    level, text = found()
    assert (level, text) == (
        "fail",
        f"{home}/authority/issued.json is damaged: restore it from a copy",
    )
