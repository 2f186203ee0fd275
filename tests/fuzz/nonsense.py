"""Well-sealed messages that make no sense."""

import json
from typing import Any

import msgpack
import numpy as np

from sumo_dist.wire.codec import seal, unseal

_WHOLE = (0, 1, -1, 2**31, 2**53, 2**63 - 1, -(2**63))
_TEXTS = ("", "\0", "x" * 300, "é/*$", "nan", "-1e300", "9" * 30, "a=b,c")
_FLOATS = (0.0, -0.0, 1e-300, 1e300, -1e300, float("inf"), float("-inf"), float("nan"))


def nonsense(payload: bytes, rng: np.random.Generator) -> bytes:
    """Change one field of a message, or one deep in it, and seal it again."""
    body = msgpack.unpackb(unseal(payload))
    _spoil(body, rng)
    try:
        return seal(msgpack.Packer().pack(body))
    except (ValueError, OverflowError):
        return payload


def _spoil(body: Any, rng: np.random.Generator) -> None:
    """Change one thing in a mapping or a list, or deep in it."""
    place, keys = body, list(body)
    while True:
        key = keys[rng.integers(len(keys))]
        inner = place[key]
        if not isinstance(inner, (dict, list)) or not inner or rng.random() < 0.2:
            break
        place, keys = inner, list(inner) if isinstance(inner, dict) else list(range(len(inner)))
    place[key] = _other(inner, rng)


def _other(value: Any, rng: np.random.Generator) -> Any:
    """Something else, mostly of the same kind."""
    if rng.random() < 0.2:
        return [None, True, 7, "x", b"x", [], {}, 0.5][rng.integers(8)]
    match value:
        case bool():
            return not value
        case int():
            return int(rng.choice(np.array([*_WHOLE, value + 1, value - 1], object)))
        case float():
            return float(rng.choice([*_FLOATS, -value, value * 2]))
        case str():
            texts = [*_TEXTS, value + "x", value[:-1], *6 * [_other_json(value, rng)]]
            return texts[rng.integers(len(texts))]
        case bytes() if len(value) >= 8:
            at = int(rng.integers(0, len(value) // 8)) * 8
            return value[:at] + np.float64(rng.choice(_FLOATS)).tobytes() + value[at + 8 :]
    return value


def _other_json(text: str, rng: np.random.Generator) -> str:
    """Change one thing in a JSON object; other texts are left as they are."""
    try:
        body = json.loads(text)
        _spoil(body, rng)
    except (ValueError, TypeError):
        return text
    return json.dumps(body, default=repr)
