"""Who may say and hear what at a router with keys: Zenoh's access list, from the messages' own.

Everything else is denied. A role is known by its certificate's common name, and Zenoh compares
whole names only: the list has every name that the authority can issue, but for the revoked ones.
"""

from collections.abc import Collection, Iterator
from typing import Any

from sumo_dist.authority.certificates import NUMBERS, ROLES, ROUTER
from sumo_dist.wire import messages, notices
from sumo_dist.wire.keys import ANY, POOL, SCHEMA, WORKER
from sumo_dist.wire.messages import Message
from sumo_dist.wire.schema import MAX_BYTES

# role of a certificate -> roles of the tokens by which its services are seen
ANNOUNCES: dict[str, tuple[str, ...]] = {
    "robot": ("robot", "estimator"),
    "optimizer": ("optimizer",),
    "worker": (WORKER, "trial-worker"),
    "tracer": ("tracer",),
    "operator": ("operator",),
}
KINDS: tuple[type[Message], ...] = tuple(
    kind
    for module in (messages, notices)
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
)
_ALL = "sumo/**"
_TOKENS = "sumo/alive/**"
_EVERYTHING = (
    *("put", "delete", "declare_subscriber", "query", "reply", "declare_queryable"),
    *("liveliness_token", "liveliness_query", "declare_liveliness_subscriber"),
)


def access_control(revoked: Collection[str]) -> dict[str, Any]:
    """Return Zenoh's section of this name: roles by certificate, and all who dial loopback TCP.

    Args:
        revoked: common names that are not accepted.
    """
    rules, subjects, policies = [], [], []
    for role in ROLES:
        if role == ROUTER:
            continue
        granted = list(_rules(role))
        rules += granted
        numbers = range(1, NUMBERS + 1)
        names = [name for i in numbers if (name := f"{role}.{i}") not in revoked]
        subjects.append({"id": role, "cert_common_names": names, "link_protocols": ["tls"]})
        policies.append({"rules": [rule["id"] for rule in granted], "subjects": [role]})
    here = _rule("here", ("ingress", "egress"), _EVERYTHING, ["**"])
    subjects.append(
        {"id": "here", "interfaces": ["lo", "lo0"], "link_protocols": ["tcp"]}  # Linux, macOS
    )
    policies.append({"rules": ["here"], "subjects": ["here"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [*rules, here],
        "subjects": subjects,
        "policies": policies,
    }


def size_limits() -> list[dict[str, Any]]:
    """Return Zenoh's `low_pass_filter`: the most bytes on each topic, and elsewhere."""
    limits: dict[int, list[str]] = {MAX_BYTES: ["**"]}
    for kind in KINDS:
        limits.setdefault(kind.most_bytes, []).append(_keys(kind))
    return [
        {
            "id": f"at-most-{most}",
            "flows": ["ingress"],
            "messages": ["put", "delete", "query", "reply"],
            "key_exprs": keys,
            "size_limit": most,
        }
        for most, keys in limits.items()
    ]


def _rules(role: str) -> Iterator[dict[str, Any]]:
    """Yield what is granted to a role. "ingress" is what it says, "egress" what reaches it."""
    if says := [_keys(kind) for kind in KINDS if role in kind.sent_by]:
        yield _rule(f"{role}-says", ("ingress",), ("put",), says)
        # A publisher is told who listens, on a key that includes the listener's: else it takes it
        # that nobody does and sends nothing, from its second message on.
        yield _rule(f"{role}-listeners", ("egress",), ("declare_subscriber",), [_ALL])
    if hears := [_keys(kind) for kind in KINDS if role in kind.heard_by]:
        yield _rule(f"{role}-asks", ("ingress",), ("declare_subscriber",), hears)
        yield _rule(f"{role}-hears", ("egress",), ("put",), hears)
    if tokens := [f"sumo/alive/*/{name}/*/*/*" for name in ANNOUNCES[role]]:
        yield _rule(f"{role}-is-there", ("ingress",), ("liveliness_token",), tokens)
    watching = ("declare_liveliness_subscriber", "liveliness_query")
    yield _rule(f"{role}-watches", ("ingress",), watching, [_TOKENS])
    yield _rule(f"{role}-sees", ("egress",), ("liveliness_token",), [_TOKENS])


def _rule(id: str, flows: Any, messages: Any, keys: list[str]) -> dict[str, Any]:  # noqa: A002
    return {
        "id": id,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": keys,
    }


def _keys(kind: type[Message]) -> str:
    """Key expression of a kind of message, at any robot's bus."""
    whose = POOL if kind.pooled else ANY
    return f"sumo/v{SCHEMA}/{whose}/{kind.topic}" + ("/*" if kind.addressed_by else "")
