"""Messages to bytes and back: a msgpack map with the schema's version and the message's type.

A checksum goes before it. Most flipped bits would land in arrays and be believed: a state that is
wrong and finite is the one fault that no other check finds.
"""

import zlib
from typing import TypeVar

import msgpack

from sumo_dist.wire.keys import SCHEMA
from sumo_dist.wire.messages import Message
from sumo_dist.wire.schema import MAX_BYTES, WireError, record

M = TypeVar("M", bound=Message)

CHECKSUM_BYTES = 4

# msgpack allocates what a header claims before it reads on: claims beyond any message are refused
_LIMITS = {"max_array_len": 16, "max_map_len": 64, "max_ext_len": 0, "max_str_len": 1 << 16}


def encode(message: Message) -> bytes:
    """Encode a message; raise WireError if its receiver would reject it."""
    kind = type(message)
    body = {"v": SCHEMA, "type": kind.__name__, **record(kind).pack(message, {})}
    try:
        payload = msgpack.Packer().pack(body)
    except ValueError as error:  # a text with lone surrogates
        raise WireError("field", str(error)) from None
    if len(payload) > MAX_BYTES:
        raise WireError("size", f"{len(payload)} bytes, at most {MAX_BYTES}")
    return seal(payload)


def seal(packed: bytes) -> bytes:
    """Put the checksum, CRC-32 little-endian, before a packed message."""
    return zlib.crc32(packed).to_bytes(CHECKSUM_BYTES, "little") + packed


def unseal(payload: bytes) -> bytes:
    """Return the packed message, or raise WireError if it is not what its sender has sealed."""
    packed = payload[CHECKSUM_BYTES:]
    if len(payload) > MAX_BYTES + CHECKSUM_BYTES:
        raise WireError("size", f"{len(packed)} bytes, at most {MAX_BYTES}")
    if len(payload) <= CHECKSUM_BYTES or seal(packed) != payload:
        raise WireError("checksum", f"{len(payload)} bytes")
    return packed


def decode(kind: type[M], payload: bytes) -> M:
    """Decode a message of a known type; raise WireError, and nothing else, for any other bytes."""
    packed = unseal(payload)
    try:
        body = msgpack.unpackb(packed, max_bin_len=MAX_BYTES, **_LIMITS)
    except (ValueError, TypeError) as error:
        raise WireError("malformed", f"{type(error).__name__} {error!s:.200}") from None
    if type(body) is not dict:
        raise WireError("malformed", f"needs a map, got {type(body).__name__}")
    if (version := body.pop("v", None)) != SCHEMA:
        raise WireError("version", f"this is schema {SCHEMA}, got {version!r:.80}")
    if (name := body.pop("type", None)) != kind.__name__:
        raise WireError("type", f"needs {kind.__name__}, got {name!r:.80}")
    return record(kind).unpack(body, {})
