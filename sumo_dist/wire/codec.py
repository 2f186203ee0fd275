"""Messages to bytes and back: a msgpack map with the schema's version and the message's type.

A checksum goes before it. Most flipped bits would land in arrays and be believed: a state that is
wrong and finite is the one fault that no other check finds.
"""

import zlib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

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


class Template:
    """Messages that differ in a few fields only: what they share is packed once."""

    def __init__(self, message: Message, own: Sequence[str]) -> None:
        """Take what is shared from one of the messages.

        Args:
            message: one of them.
            own: names of the fields that each has for itself.
        """
        kind = type(message)
        self._record, self._dims = record(kind), {}
        names = [name for name in self._record.rules if name not in own]
        shared = {"v": SCHEMA, "type": kind.__name__} | self._record.pack_some(
            {name: getattr(message, name) for name in names}, self._dims
        )
        header = msgpack.Packer().pack_map_header(len(shared) + len(own))
        self._head = header + _pairs(shared)
        self._sum = zlib.crc32(self._head)

    def encode(self, **own: Any) -> bytes:
        """Encode a message of which the fields of its own are given; see the function `encode`."""
        body = _pairs(self._record.pack_some(own, dict(self._dims)))
        if (size := len(self._head) + len(body)) > MAX_BYTES:
            raise WireError("size", f"{size} bytes, at most {MAX_BYTES}")
        checksum = zlib.crc32(body, self._sum).to_bytes(CHECKSUM_BYTES, "little")
        return b"".join((checksum, self._head, body))


def _pairs(packed: Mapping[str, Any]) -> bytes:
    """A map's names and values as msgpack has them, without the header before them."""
    pack = msgpack.Packer(autoreset=False)
    for name, value in packed.items():
        pack.pack(name)
        pack.pack(value)
    return pack.bytes()


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
