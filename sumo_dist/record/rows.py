"""Arrays that come one by one for hours, in little memory."""

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

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
        self._kind = np.empty(0)  # the first row: what a row is like
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
        return np.array(self._rested()[row])[()]

    def __iter__(self) -> Iterator[Any]:
        if self._resting:
            yield from self._rested()
        yield from (row[()] for row in self._fresh)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return all rows, (len(self), ...)."""
        rows = np.array(self._fresh, self._kind.dtype)
        if self._resting:
            rows = np.concatenate([self._rested(), *([rows] if self._fresh else [])])
        return rows if dtype is None else rows.astype(dtype)

    def _rested(self) -> np.ndarray:
        shape = (self._resting, *self._kind.shape)
        return np.memmap(self._file, self._kind.dtype, "r", shape=shape)
