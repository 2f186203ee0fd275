import json
import re
from itertools import product
from pathlib import Path

import pytest

from sumo_dist.authority.certificates import NUMBERS, ROLES
from sumo_dist.wire.access import ANNOUNCES, KINDS, access_control, size_limits
from sumo_dist.wire.keys import SCHEMA
from sumo_dist.wire.schema import MAX_BYTES

PAGE = Path(__file__).parents[2] / "SECURITY.md"
CLIENTS = [role for role in ROLES if role != "router"]


def granted(role, flow, message):
    """Key expressions that a role is granted."""
    control = access_control([])
    ids = next(p["rules"] for p in control["policies"] if p["subjects"] == [role])
    rules = [rule for rule in control["rules"] if rule["id"] in ids]
    return {
        key
        for rule in rules
        if flow in rule["flows"] and message in rule["messages"]
        for key in rule["key_exprs"]
    }


@pytest.mark.parametrize("kind", KINDS)
def test_every_message_has_who_sends_and_who_hears_it(kind):
    assert kind.sent_by
    assert kind.heard_by
    assert set(kind.sent_by + kind.heard_by) <= set(CLIENTS)


@pytest.mark.parametrize("role", CLIENTS)
def test_a_role_is_granted_what_its_messages_say_and_no_more(role):
    def topics(keys):
        return {key.split("/")[3] for key in keys}

    says = {kind.topic for kind in KINDS if role in kind.sent_by}
    hears = {kind.topic for kind in KINDS if role in kind.heard_by}
    assert topics(granted(role, "ingress", "put")) == says
    assert topics(granted(role, "egress", "put")) == hears
    assert topics(granted(role, "ingress", "declare_subscriber")) == hears
    everything = granted(role, "ingress", "put") | granted(role, "egress", "put")
    assert all(key.startswith(f"sumo/v{SCHEMA}/") for key in everything)
    for flow, message in product(
        ("ingress", "egress"), ("delete", "query", "reply", "declare_queryable")
    ):
        assert granted(role, flow, message) == set()


def test_only_an_operator_commands_only_an_optimizer_plans_and_only_a_robot_senses():
    by_topic = {kind.topic: kind.sent_by for kind in KINDS}
    assert by_topic["command"] == ("operator",)
    assert by_topic["plan"] == by_topic["no-plan"] == by_topic["request"] == ("optimizer",)
    assert by_topic["sensors"] == by_topic["state"] == by_topic["end"] == ("robot",)
    assert [role for role in CLIENTS if not granted(role, "ingress", "put")] == ["tracer"]


@pytest.mark.parametrize("role", CLIENTS)
def test_a_role_is_seen_as_nothing_else(role):
    tokens = granted(role, "ingress", "liveliness_token")
    assert tokens == {f"sumo/alive/*/{name}/*/*/*" for name in ANNOUNCES[role]}


def test_a_revoked_name_and_no_other_is_left_out():
    names = {s["id"]: s.get("cert_common_names") for s in access_control({"worker.7"})["subjects"]}
    assert names["worker"] == [f"worker.{i}" for i in range(1, NUMBERS + 1) if i != 7]
    assert len(names["robot"]) == NUMBERS


def test_without_keys_only_loopback_is_let_in():
    subjects = access_control([])["subjects"]
    assert [s for s in subjects if not s.get("cert_common_names")] == [
        {"id": "here", "interfaces": ["lo", "lo0"], "link_protocols": ["tcp"]}
    ]
    assert all(s["link_protocols"] == ["tls"] for s in subjects if s["id"] != "here")


def test_nothing_may_be_longer_than_the_longest_message():
    limits = {rule["size_limit"]: rule["key_exprs"] for rule in size_limits()}
    assert max(limits) == MAX_BYTES
    assert "**" in limits[MAX_BYTES]
    assert f"sumo/v{SCHEMA}/*/command" in limits[128 << 10]
    json.dumps(size_limits())


def test_the_page_has_the_same_table():
    rows = dict(re.findall(r"^\| (\w+) \| (.+\| .+ \| .+) \|$", PAGE.read_text("utf-8"), re.M))
    for role in CLIENTS:
        expected = [
            ", ".join(sorted(kind.topic for kind in KINDS if role in getattr(kind, side))) or "-"
            for side in ("sent_by", "heard_by")
        ]
        assert rows[role] == " | ".join([*expected, ", ".join(ANNOUNCES[role]) or "-"])
