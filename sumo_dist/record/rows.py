"""Arrays that come one by one for hours, in little memory."""

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from typing import IO, Any

import numpy as np

SPILL_BYTES = 1_000_000  # rows of so much move to the file
OVERHEAD_BYTES = 128  # of a row in memory, beside its numbers


class Rows(Sequence[Any]):
    """A growing array, appended row by row; all rows have the shape and type of the first.

    What was appended long ago rests in an unnamed file in the folder for temporary files (TMPDIR),
    which is gone when the process is. Where no file can be written the rows stay in memory.
    """

    def __init__(self, rows: Iterable[Any] = ()) -> None:
        """Start with some rows."""
        self._fresh: list[np.ndarray] = []
        self._kind = np.zeros(())  # the first row: what a row is like
        self._file: Any = None  # of bytes
        self._resting = 0  # rows in the file
        self._spills = True
        for row in rows:
            self.append(row)

    def append(self, row: Any) -> None:
        """Append a copy of a row.

        Raises:
            ValueError: its shape is not that of the rows before.
        """
        if not len(self):
            self._kind = np.array(row)
        fresh = np.array(row, self._kind.dtype)
        if fresh.shape != self._kind.shape:
            raise ValueError(f"a row of shape {fresh.shape} among rows of shape {self._kind.shape}")
        self._fresh.append(fresh)
        if self._spills and len(self._fresh) > 1 + SPILL_BYTES // (fresh.nbytes + OVERHEAD_BYTES):
            self._spill()

    def cut(self, length: int) -> None:
        """Drop the last rows, so that no more than `length` are left."""
        self._resting = min(self._resting, length)
        del self._fresh[length - self._resting :]

    def _spill(self) -> None:
        """Move all fresh rows to the file."""
        moving = np.array(self._fresh)
        try:
            self._file = self._file or tempfile.TemporaryFile()  # noqa: SIM115  # lives as we do
            self._file.seek(self._resting * self._kind.nbytes)
            self._file.write(moving.tobytes())
            self._file.flush()
        except OSError:  # a full disk costs memory, not rows
            self._spills = False
            return
        self._resting, self._fresh = self._resting + len(moving), []

    def __len__(self) -> int:
        return self._resting + len(self._fresh)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return np.array(self)[index]
        row = range(len(self))[index]
        if row >= self._resting:
            return self._fresh[row - self._resting][()]
        return self._read(row, 1)[0]

    def __iter__(self) -> Iterator[Any]:
        for block in self._blocks():
            yield from block

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return all rows, (len(self), ...)."""
        rows = np.empty((len(self), *self._kind.shape), self._kind.dtype)
        begin = 0
        for block in self._blocks():
            rows[begin : begin + len(block)] = block
            begin += len(block)
        return rows if dtype is None else rows.astype(dtype)

    def write(self, file: IO[bytes]) -> None:
        """Write all rows as a .npy file, without ever having them all in memory."""
        header = {
            "descr": np.lib.format.dtype_to_descr(self._kind.dtype),
            "fortran_order": False,
            "shape": (len(self), *self._kind.shape),
        }
        np.lib.format.write_array_header_1_0(file, header)
        for block in self._blocks():
            file.write(block.tobytes())

    def _blocks(self) -> Iterator[np.ndarray]:
        """Yield all rows, some SPILL_BYTES of them at a time."""
        size = 1 + SPILL_BYTES // max(1, self._kind.nbytes)
        for begin in range(0, self._resting, size):
            yield self._read(begin, min(size, self._resting - begin))
        if self._fresh:
            yield np.array(self._fresh)

    def _read(self, begin: int, count: int) -> np.ndarray:
        """Return rows of the file."""
        self._file.seek(begin * self._kind.nbytes)
        read = self._file.read(count * self._kind.nbytes)
        return np.ndarray((count, *self._kind.shape), self._kind.dtype, read)
