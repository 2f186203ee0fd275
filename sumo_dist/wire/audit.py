"""Who was refused, and from where, as far as Zenoh tells: a line each in the router's log.

Zenoh has no call for it. It writes what it refuses to its own log on standard output, part of it at
the lowest level, two lines a message. So while a router with keys runs, standard output is a pipe,
and what comes out of it is told once: by certificate and address where a peer was let in, without a
source where TLS itself failed, for there Zenoh names none.
"""

import logging
import os
import re
import sys
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import zenoh

FILTER = (
    "error,zenoh_link_tls=debug,zenoh_transport::unicast::establishment::accept=debug,"
    "zenoh::net::routing::interceptor::access_control=trace"
)
_REMEMBERED = 1000  # of refusals and peers; of more, the oldest are forgotten
_READ_BYTES = 1 << 20
_COLOURS = re.compile(rb"\x1b\[[0-9;]*m")
_ACCEPTED = re.compile(r"Accepted TLS connection on \S+: (\S+)\. Common Name: (.+)\.$")
_OPENED = re.compile(r"New transport link accepted from ([0-9a-f]+) .*? dst: tls/([^ ,]+)")
_NUMBER = re.compile(r"\d+")
_FAILED = re.compile(r"zenoh_link_tls::unicast: (.*?)\. Hint: ")
_CACHING = re.compile(r" (rx-\d+) .*caching permissions for `(\S+)`")
_REFUSED = re.compile(
    r" (rx-\d+) .*?(Using cached result: )?([0-9a-f]+) (?:on \S+ )?is unauthorized to "
    r"([\w /]+) \(ingress\) on (\S+)"
)

V = TypeVar("V")

_log = logging.getLogger("sumo_dist.router")


@contextmanager
def audited() -> Iterator[None]:
    """Tell who is refused while this lasts; not if RUST_LOG asks for Zenoh's log itself."""
    if "RUST_LOG" in os.environ:
        zenoh.try_init_log_from_env()
        yield
        return
    sys.stdout.flush()
    before, (reading, writing) = os.dup(1), os.pipe()
    os.dup2(writing, 1)
    os.close(writing)
    reader = threading.Thread(target=_read, args=(reading,), daemon=True)
    reader.start()
    zenoh.init_log_from_env_or(FILTER)
    try:
        yield
    finally:
        os.dup2(before, 1)  # closes the pipe's only end to write to
        os.close(before)
        reader.join(1.0)


def _read(pipe: int) -> None:
    audit, rest = Audit(), b""
    with os.fdopen(pipe, "rb", buffering=0) as opened:
        while chunk := opened.read(_READ_BYTES):
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                audit.take(line)


class Audit:
    """Makes lines for people of the lines of Zenoh's log."""

    def __init__(self) -> None:
        """Start without having seen anything."""
        self._names: OrderedDict[str, str] = OrderedDict()  # by address
        self._peers: OrderedDict[str, str] = OrderedDict()  # by session: name and address
        self._told: OrderedDict[str, None] = OrderedDict()
        # by thread: the key whose permissions it lists, and those listed: nothing is refused yet
        self._listing: dict[str, tuple[str, set[str]]] = {}

    def take(self, line: bytes) -> None:
        """Take a line."""
        if b" is authorized to " in line:  # nearly all
            return
        text = _COLOURS.sub(b"", line).decode(errors="replace")
        if match := _REFUSED.search(text):
            self._refused(*match.groups())
        elif match := _CACHING.search(text):
            self._listing[match[1]] = match[2], set()
        elif match := _ACCEPTED.search(text):
            _remember(self._names, match[1], match[2])
        elif match := _OPENED.search(text):
            session, address = match.groups()
            _remember(self._peers, session, f"{self._names.get(address, '?')} from {address}")
        elif (match := _FAILED.search(text)) and "handshake eof" not in text:  # only a look
            kind = _NUMBER.sub("#", match[1])  # an expired certificate comes with the time of now
            self._tell(f"refused a connection, whose source Zenoh does not tell: {match[1]}", kind)

    def _refused(self, thread: str, cached: str | None, session: str, what: str, key: str) -> None:
        listed, seen = self._listing.get(thread, ("", set()))
        if cached is None and key == listed and what not in seen:
            seen.add(what)
            return
        who = self._peers.get(session, f"session {session}")
        self._tell(f"refused {who}: {what.lower()} on {key}")

    def _tell(self, text: str, kind: str = "") -> None:
        """Tell the first of a kind; by default each text is one."""
        if (kind or text) not in self._told:
            _remember(self._told, kind or text, None)
            _log.warning("%s (told once)", text)


def _remember(where: OrderedDict[str, V], key: str, value: V) -> None:
    where[key] = value
    if len(where) > _REMEMBERED:
        where.popitem(last=False)
