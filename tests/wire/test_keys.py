import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_dist.errors import UsageError
from sumo_dist.wire.keys import (
    ANY,
    Member,
    alive_key,
    alive_keys,
    checked_name,
    parse_alive,
    topic_key,
    unique_name,
)


def test_topics_carry_the_version_and_the_robot():
    assert topic_key("spot", "state") == "sumo/v7/spot/state"
    assert topic_key("spot", "request", "w-1") == "sumo/v7/spot/request/w-1"
    assert topic_key("spot", "reply", ANY) == "sumo/v7/spot/reply/*"


@pytest.mark.parametrize("name", ["", "a/b", "a*", "$x", "a?", "a#", "-a", "ä", "a" * 65, "a\n"])
def test_names_that_would_break_a_key_are_refused(name):
    member = Member(name, "1", 1, "-")
    for make in (lambda: topic_key(name, "state"), lambda: topic_key("spot", "reply", name),
                 lambda: alive_key("spot", member), lambda: alive_keys("spot", name)):  # fmt: skip
        with pytest.raises(UsageError, match="not a valid name"):
            make()


@given(build=st.text(st.characters(exclude_categories=["Cs"]), min_size=1))
def test_members_survive_their_key_whatever_their_build_is_called(build):
    member = Member("rollout-worker", "host-12", 3, build)
    key = alive_key("spot", member)
    assert not set(key) & set("*$?#")
    assert parse_alive(key) == member


@pytest.mark.parametrize(
    "key", ["", "sumo/alive/spot/x", "sumo/alive/spot/x/1/one/-", "a/b/c/d/e/1/-"]
)
def test_foreign_keys_name_no_member(key):
    assert parse_alive(key) is None


def test_a_unique_name_is_a_name_whatever_the_host_is_called(monkeypatch):
    for host in ("plain", "mac.local", "ünïcode", "-", "a" * 200, ""):
        monkeypatch.setattr("socket.gethostname", lambda host=host: host)
        assert checked_name("id", unique_name()) == unique_name()
