"""Logs that hold arrays by name, some in groups or structs: which of them are columns, and what they are called."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, SteelyardError

from ..column_styles import LABELS
from .dates import origin_of_dates, seconds_of_texts
from .log_file import Columns, LogFile, common_length, less_offset, offset_of, reason_of

__all__ = ["MOST_JOINTS", "ArrayLog", "StoredArray", "dates_stored", "part_of", "texts_of"]

MOST_JOINTS = 1000
"""Columns of an array; one with more is a picture, or has its rows and columns exchanged."""
LONGEST_LABEL = 200
OBJECTS = (
    " but objects of MATLAB, which only MATLAB reads; save plain arrays, as with s = table2struct(T, ToScalar=true); "
    "save('run.mat', '-struct', 's')"
)
"""What a message says of files whose variables are tables or time series."""


@dataclass(frozen=True, eq=False)
class StoredArray:
    """An array of a file.

    Parameters
    ----------
    path : tuple of str
        The groups or structs in which it stands, and its name.
    take : callable
        ``take(start, stop, axis)`` reads a part of it along one axis, as float64.
    offset, origin : int
        See `LogFile`.
    """

    path: tuple[str, ...]
    shape: tuple[int, ...]
    take: Callable[[int, int, int], NDArray[np.float64]]
    offset: int = 0
    origin: int = 0

    @classmethod
    def of_numbers(
        cls, path: tuple[str, ...], shape: tuple[int, ...], raw: Callable[[int, int, int], NDArray[Any]]
    ) -> StoredArray:
        """Return an array of numbers, parts of which `raw` reads; the first is taken off large whole ones in a vector.

        Examples
        --------
        >>> ns = np.array([1732284307250000000, 1732284307254000001])
        >>> stored = StoredArray.of_numbers(("t",), ns.shape, lambda start, stop, axis: ns[start:stop])
        >>> stored.offset, stored.take(0, 2, 0).tolist()
        (1732284307250000000, [0.0, 4000001.0])
        """
        offset = 0
        if 0 < max(shape, default=0) == math.prod(shape):
            with contextlib.suppress(Exception):  # of a damaged array, which is told when it is read
                offset = offset_of(np.ravel(raw(0, 1, shape.index(max(shape))))[0])

        def take(start: int, stop: int, axis: int) -> NDArray[np.float64]:
            return less_offset(raw(start, stop, axis), offset)

        return cls(path, shape, take, offset)


@dataclass(frozen=True, eq=False)
class _Matrix:
    """Rows and columns of a stored array."""

    stored: StoredArray
    axis: int
    """The axis along which the rows lie."""

    @property
    def rows(self) -> int:
        return self.stored.shape[self.axis]

    @property
    def width(self) -> int:
        return int(np.prod(self.stored.shape)) // self.rows

    def block(self, start: int, stop: int) -> NDArray[np.float64]:
        """Return (stop - start, width)."""
        taken = self.stored.take(start, stop, self.axis)
        return np.moveaxis(taken, self.axis, 0).reshape(stop - start, self.width)


class ArrayLog(LogFile):
    """A log of arrays: vectors are columns, and matrices are one column for each joint.

    A format derived from this one lists the arrays with `_store`. Rows lie along the axis that is as long as the
    vectors are. The columns of a matrix `q` are called ``q_0``, ``q_1`` and so on, or ``q[elbow]`` where the file names
    as many joints; groups that hold everything are left out of the names.
    """

    joiner: ClassVar[str] = "/"
    """What stands between the names of groups."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._labels: tuple[str, ...] = ()
        self._columns: dict[str, tuple[_Matrix, int]] = {}

    def _store(
        self, arrays: Sequence[StoredArray], texts: Mapping[tuple[str, ...], Sequence[str]], has_objects: bool
    ) -> None:
        """Take note of all arrays of numbers, of the lists of texts, and of whether there are objects of MATLAB."""
        lists = (tuple(found) for path, found in texts.items() if path[-1].lower() in LABELS)
        self._labels = next((found for found in lists if len(found) > 1), ())  # a single `name` is that of the log
        arrays = [*arrays, *(one for path, found in texts.items() if (one := dates_stored(path, found)) is not None)]
        matrices = [matrix for matrix in _matrices(arrays) if matrix.width <= MOST_JOINTS]
        common = _common_groups([matrix.stored.path for matrix in matrices])
        for matrix in matrices:
            name = self.joiner.join(matrix.stored.path[common:])
            if matrix.width == 1:
                self._columns[name] = matrix, 0
                continue
            named = len(self._labels) == matrix.width == len(set(self._labels))
            for index in range(matrix.width):
                label = f"{name}[{self._labels[index]}]" if named else f"{name}_{index}"
                self._columns[label] = matrix, index
        self.names = tuple(self._columns)
        if not self.names:
            hint = OBJECTS if has_objects else "; expected a time, positions and torques"
            raise InputError(f"{self.path} holds no arrays of numbers with one row per sample{hint}.")

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints, where an array of texts names them."""
        return self._labels

    def offset(self, name: str) -> int:
        """See `LogFile.offset`."""
        return self._columns[name][0].stored.offset

    def origin(self, name: str) -> int:
        """See `LogFile.origin`."""
        return self._columns[name][0].stored.origin

    def count(self) -> int:
        """Return the number of rows, that of the longest array."""
        return max(matrix.rows for matrix, _ in self._columns.values())

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""
        return next(self.blocks_from(0, names, self._rows(names)), {}) if names else {}

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of rows, from row `start` on; an array is read once for all of its columns."""
        total = self._rows(names)
        places = {name: self._columns[name] for name in names}
        matrices = dict.fromkeys(matrix for matrix, _ in places.values())
        for first in range(start, total, rows):
            taken = {matrix: self._taken(matrix, first, min(first + rows, total)) for matrix in matrices}
            yield {name: np.ascontiguousarray(taken[matrix][:, index]) for name, (matrix, index) in places.items()}

    def _taken(self, matrix: _Matrix, start: int, stop: int) -> NDArray[np.float64]:
        try:
            return matrix.block(start, stop)
        except SteelyardError:
            raise
        except Exception as error:  # the libraries raise whatever they meet in a damaged file
            reason = reason_of(error)
            name = self.joiner.join(matrix.stored.path)
            raise InputError(f"{self.path}: its array {name} cannot be read ({reason}); save it again.") from None

    def _rows(self, names: Sequence[str]) -> int:
        matrices = (self._columns[name][0] for name in names)
        return common_length(self.path, {self.joiner.join(matrix.stored.path): matrix.rows for matrix in matrices})


def dates_stored(path: tuple[str, ...], texts: Any) -> StoredArray | None:
    """Return texts that are dates as an array of times, s; None where they are something else.

    Examples
    --------
    >>> dates_stored(("log", "t"), ["2026-11-22 14:05:07", "2026-11-22 14:05:08"]).shape
    (2,)
    """
    array = np.ravel(np.asarray(texts))
    if seconds_of_texts(array[:1]) is None:
        return None
    origin = origin_of_dates(array.tolist())
    seconds = seconds_of_texts(array, origin)
    return None if seconds is None else StoredArray(path, seconds.shape, partial(part_of, seconds), origin=origin)


def _matrices(arrays: Sequence[StoredArray]) -> list[_Matrix]:
    """Find along which axis the rows of each array lie; arrays that are no tables are passed over."""
    sizes = {array: [size for size in array.shape if size != 1] for array in arrays if 0 not in array.shape}
    tables = {array: size for array, size in sizes.items() if len(size) in (1, 2)}
    vectors = Counter(size[0] for size in tables.values() if len(size) == 1)
    # As many rows as most of the arrays can have; where there are vectors, as long as they are.
    votes = Counter(length for size in tables.values() for length in set(size) if not vectors or length in vectors)
    rows = max(votes, key=lambda length: (votes[length], length), default=0)
    return [_Matrix(array, array.shape.index(rows if rows in size else max(size))) for array, size in tables.items()]


def _common_groups(paths: Sequence[tuple[str, ...]]) -> int:
    """Return how many groups hold everything."""
    count = 0
    while all(len(path) > count + 1 for path in paths) and len({path[count] for path in paths}) == 1:
        count += 1
    return count


def part_of(array: Any, start: int, stop: int, axis: int) -> NDArray[Any]:
    """Return the part start:stop along one axis of an array, or of what is sliced like one."""
    part = tuple(slice(start, stop) if k == axis else slice(None) for k in range(len(array.shape)))
    return np.asarray(array[part])


def texts_of(values: Any) -> tuple[str, ...]:
    """Return an array or list of texts as texts without the blanks that fill them; empty where it is something else.

    Examples
    --------
    >>> texts_of(np.array([b"elbow ", b"wrist"])), texts_of([1, 2])
    (('elbow', 'wrist'), ())
    """
    flat = [np.asarray(values).item()] if np.ndim(values) == 0 else list(np.ravel(np.asarray(values)))
    texts = [one.decode("utf-8", errors="replace") if isinstance(one, bytes) else one for one in flat]
    if len(texts) > MOST_JOINTS or not all(isinstance(one, str) and len(one) <= LONGEST_LABEL for one in texts):
        return ()
    return tuple(str(one).strip().strip("\0") for one in texts)
