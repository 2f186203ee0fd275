"""Turn good messages into bad ones, for the fault bridge."""

from collections.abc import Callable

import msgpack
import numpy as np

from sumo_dist.wire.codec import seal, unseal

Tamper = Callable[[bytes, np.random.Generator], bytes]


def garbage(payload: bytes, rng: np.random.Generator) -> bytes:
    """Overwrite some bytes at random."""
    changed = np.frombuffer(payload, np.uint8).copy()
    places = rng.integers(0, len(changed), rng.integers(1, 9))
    changed[places] ^= rng.integers(1, 256, len(places), np.uint8)
    return changed.tobytes()


def truncated(payload: bytes, rng: np.random.Generator) -> bytes:
    """Cut the end off."""
    return payload[: rng.integers(0, len(payload))]


def other_version(payload: bytes, _rng: np.random.Generator) -> bytes:
    """Claim to be of the next schema."""
    body = msgpack.unpackb(unseal(payload))
    return seal(msgpack.Packer().pack({**body, "v": body["v"] + 1}))


def lying(payload: bytes, _rng: np.random.Generator) -> bytes:
    """Make every cost of a reply NaN; leave other messages as they are."""
    body = msgpack.unpackb(unseal(payload))
    if body["type"] != "RolloutReply" or not body["terms"][2]:
        return payload
    code, shape, data = body["terms"]
    body["terms"] = [code, shape, np.full(len(data) // 8, np.nan).tobytes()]
    return seal(msgpack.Packer().pack(body))


def misshapen(payload: bytes, _rng: np.random.Generator) -> bytes:
    """Answer with one row fewer than was asked for; leave other messages as they are."""
    body = msgpack.unpackb(unseal(payload))
    if body["type"] != "RolloutReply" or body["terms"][1][0] < 2:
        return payload
    (code, (rows, terms), data), (mask, _, valid) = body["terms"], body["valid"]
    body["terms"] = [code, [rows - 1, terms], data[: -8 * terms]]
    body["valid"] = [mask, [rows - 1], valid[:-1]]
    return seal(msgpack.Packer().pack(body))


TAMPERS: dict[str, Tamper] = {
    "garbage": garbage,
    "truncate": truncated,
    "version": other_version,
    "lie": lying,
    "misshape": misshapen,
}
