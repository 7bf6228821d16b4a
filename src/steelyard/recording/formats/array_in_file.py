"""Arrays of numbers as they stand in a file, of which parts are read in bounded memory whatever their order."""

from __future__ import annotations

import math
import shutil
import tempfile
import weakref
from dataclasses import dataclass, field
from threading import Lock
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from .decoded import large_files

__all__ = ["ArrayInFile", "unpacked"]

COPIED = 1 << 22
"""Bytes that are copied together."""


@dataclass(frozen=True, eq=False)
class ArrayInFile:
    """An array whose numbers follow each other in a file.

    A memory map would do the same, but what was read of it counts as memory of the process for as long as there is
    room.

    Parameters
    ----------
    file : binary file
        Only its place is changed. Whoever opened it closes it, if need be when this goes; see `closing`.
    begin : int
        Byte at which the numbers begin.
    kind : dtype
    by_columns : bool
        Whether neighbours in the file differ in the first index (Fortran order), and not in the last.

    Examples
    --------
    >>> from io import BytesIO
    >>> matrix = np.arange(6.0).reshape(3, 2)
    >>> stored = ArrayInFile(BytesIO(matrix.tobytes("F")), 0, (3, 2), np.dtype(float), by_columns=True)
    >>> stored.part(1, 3).tolist(), stored.part(1, 2, axis=1).tolist()
    ([[2.0, 3.0], [4.0, 5.0]], [[1.0], [3.0], [5.0]])
    """

    file: IO[bytes]
    begin: int
    shape: tuple[int, ...]
    kind: np.dtype[Any]
    by_columns: bool
    lock: Lock = field(default_factory=Lock)

    def closing(self) -> ArrayInFile:
        """Return this array, with which its file is closed."""
        weakref.finalize(self, self.file.close)
        return self

    def part(self, start: int, stop: int, axis: int = 0) -> NDArray[Any]:
        """Read the part start:stop along one axis.

        Raises
        ------
        EOFError
            Where the file ends before it.
        """
        shape = self.shape[::-1] if self.by_columns else self.shape
        axis = len(shape) - 1 - axis if self.by_columns else axis
        outer, inner, count = math.prod(shape[:axis]), math.prod(shape[axis + 1 :]), stop - start
        with self.lock:
            if outer == 1:
                taken = self._numbers(start * inner, count * inner)
            else:
                taken = np.empty((outer, count * inner), self.kind)
                for index in range(outer):
                    taken[index] = self._numbers((index * shape[axis] + start) * inner, count * inner)
        taken = taken.reshape(*shape[:axis], count, *shape[axis + 1 :])
        return taken.T if self.by_columns else taken

    def _numbers(self, first: int, count: int) -> NDArray[Any]:
        size = self.kind.itemsize
        place = self.begin + first * size
        if self.file.tell() != place:
            self.file.seek(place)
        data = self.file.read(count * size)
        if len(data) != count * size:
            raise EOFError
        return np.frombuffer(data, self.kind)


def unpacked(stream: IO[bytes], shape: tuple[int, ...], kind: np.dtype[Any], by_columns: bool) -> ArrayInFile:
    """Copy an array from a stream into a temporary file without a name, of which nothing is left afterwards."""
    file = tempfile.TemporaryFile(prefix="steelyard-", dir=large_files())  # noqa: SIM115
    shutil.copyfileobj(stream, file, COPIED)
    return ArrayInFile(file, 0, shape, kind, by_columns).closing()
