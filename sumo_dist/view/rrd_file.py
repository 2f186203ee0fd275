"""An .rrd on disk that stays below a limit and whose failure harms nothing else.

Rerun's own file sink does neither: it grows on, and when the disk is full it can block its process
for good. So Rerun encodes into memory, and the bytes are written here.
"""

import struct
from collections.abc import Callable, Iterator
from io import FileIO
from pathlib import Path

LIMIT = 100_000_000  # [bytes]

_HEADER = 12  # magic, version, options
_FRAME = struct.Struct("<QQ")  # kind and length of the message that follows
_END = 0  # kind of the frame that closes a stream; an index of this stream alone follows


class RrdFile:
    """Joins streams of RRD bytes to one file, without the index at each one's end.

    A file that is full, or that cannot be written, ends where it is; this is told once.
    """

    def __init__(self, path: Path, report: Callable[[str], None], limit: int = LIMIT) -> None:
        """Open the file.

        Args:
            path: to write.
            report: told in one line if the file ends early.
            limit: it never grows beyond [bytes].
        """
        self._path, self._report, self._limit = path, report, limit
        self._size = 0
        self._file: FileIO | None = None
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            self._end(f"cannot be written: {error.strerror}")

    def append(self, stream: bytes) -> None:
        """Write one whole RRD stream."""
        if self._file is None:
            return
        body = b"".join(_messages(stream))
        if self._size == 0:
            body = stream[:_HEADER] + body
        if self._size + len(body) > self._limit:
            self._end(f"has reached its limit of {self._limit / 1e6:g} MB and ends here")
            return
        try:
            written = self._file.write(body)
            if written < len(body):  # a disk that fills up takes a part first
                self._file.truncate(self._size)
                self._end("cannot be written on: no space left")
        except OSError as error:
            self._end(f"cannot be written on: {error.strerror}")
        self._size += len(body)

    def close(self) -> None:
        """Close the file; appending is ignored from now on."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _end(self, reason: str) -> None:
        self.close()
        self._report(f"{self._path} {reason}")


def _messages(stream: bytes) -> Iterator[bytes]:
    """Yield the framed messages of an RRD stream."""
    at = _HEADER
    while at < len(stream):
        kind, length = _FRAME.unpack_from(stream, at)
        if kind == _END:
            return
        yield stream[at : at + _FRAME.size + length]
        at += _FRAME.size + length
