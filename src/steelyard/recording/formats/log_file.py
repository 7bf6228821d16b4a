"""The interface of formats of log files: named columns of numbers, read whole or in blocks of rows."""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import IO, Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, SteelyardError

from ..columns import LogColumns
from ..recognition import label_columns

__all__ = [
    "BLOCK_ROWS",
    "COMPRESSED",
    "LARGEST_EXACT",
    "TEXTS",
    "Columns",
    "DataFrame",
    "LogFile",
    "column_length",
    "common_length",
    "flattened",
    "less_offset",
    "offset_of",
    "reading_as",
    "reason_of",
    "regrouped_columns",
]

Columns = dict[str, NDArray[np.float64]]
TEXTS = ("csv", "txt", "tsv", "dat", "log")
COMPRESSED = ("gz", "bz2", "xz", "lzma", "zst", "zstd")
"""Suffixes of texts that are compressed, behind their own as in ``run.csv.gz``."""
LARGEST_EXACT = 2**53
"""Whole numbers beyond this are rounded by a float64: ns since 1970 to 256 of them."""
BLOCK_ROWS = 50_000
"""Rows that are read at a time where not all are wanted in memory."""


class DataFrame(Protocol):
    """A data frame of any library that hands out its columns as an Arrow C stream, as Polars, pandas, PyArrow do."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Return a capsule of the stream."""


class LogFile(ABC):
    """One log file: its columns by name, each a float64 array (S,); missing values are NaN.

    A format of logs is a class derived from this one. Its constructor opens the file and sets `names`; `read` returns
    columns. Everything else has a default, which a format replaces where it can do better: `count` and `blocks` so
    that a log need not stand in memory as a whole, `texts` where columns may name joints, `where` where messages can
    say more than a row, and `write` where recordings are to be saved in the format, too.

    Parameters
    ----------
    path : Path
        An existing file that is not empty.

    Attributes
    ----------
    names : tuple of str
        The names of all columns.
    kept : tuple of str, or None
        The only ones that will be read; None as long as nobody has said so.
    stated : LogColumns or None
        Which column is what in which unit, for a format that knows it by itself; what a robot file says is then passed
        over. None for the others.

    Raises
    ------
    InputError
        From the constructor and from `read`, in one sentence that names the file, where it cannot be read. An OSError
        is turned into one.
    """

    saved_as: ClassVar[str | None] = None
    """The suffix under which `write` saves recordings; None where the format is only read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.names: tuple[str, ...] = ()
        self.kept: tuple[str, ...] | None = None
        self.begins: tuple[tuple[int, int], ...] = ()
        self.stated: LogColumns | None = None

    @classmethod
    def opened(cls, path: Path, columns: LogColumns) -> Self:
        """Open a file; a format replaces this where keys of `[log]`, such as `topic`, say what of the file is read."""
        return cls(path)

    @abstractmethod
    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""

    @classmethod
    def write(cls, file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write arrays (S,) and (S, M), by name, to a binary file; `Recording.save` calls this where `saved_as` is set.

        `read` must find a column of each (S,) array under its name, and of each (S, M) array under the name and 1 to M.
        """
        raise NotImplementedError

    def keep(self, names: Sequence[str]) -> None:
        """Take note that no other columns will be read, so that rows may be left out in which all of them are missing.

        What is left out is so for everything that is asked afterwards. A recording of messages has such rows, where
        the messages of other joints have stamps of their own.
        """
        self.kept = tuple(names)

    def count(self) -> int:
        """Return the number of rows."""
        return column_length(self.read(self.names[:1]))

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns from the first row to the last, `rows` rows at a time; only `blocks_from` asks for it."""
        columns = self.read(names)
        for start in range(0, column_length(columns), rows):
            yield {name: values[start : start + rows] for name, values in columns.items()}

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns as `blocks` does, from row `start` (from 0) on; formats that find a row need not read up to it.

        Wherever it begins, a block but the last holds `rows` rows.
        """
        return self.blocks(names, rows) if start == 0 else regrouped_columns(self.blocks(names, rows), rows, start)

    @classmethod
    def may_have_places(cls, path: Path) -> bool:
        """Return whether `places` may find any place in a file, as far as is known before it is opened."""
        return False

    def places(self) -> tuple[tuple[int, int], ...] | None:
        """Return where reading can begin in the middle: rows, and the bytes at which they begin where that helps.

        None where the whole file would be read, so that no other process reads a part of it. What is returned is told
        to the file that the other process opens, by `use_places`.
        """
        return None

    def use_places(self, places: tuple[tuple[int, int], ...]) -> None:
        """Take note of where reading can begin; parts of the file will be read from there."""
        self.begins = places

    def texts(self, names: Sequence[str]) -> dict[str, set[str]]:
        """Texts that stand in columns, each once; none for columns of numbers."""
        return {}

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints of numbered columns, where columns such as `name[0]` of ROS's JointState tell.

        Raises
        ------
        InputError
            Where they change from row to row.
        """
        columns = label_columns(self.names)
        found = self.texts(columns)
        labels = []
        for column in columns:
            texts = sorted(found.get(column, ()))
            if len(texts) > 1:
                raise InputError(
                    f"{self.path}: its column {column!r} names the joint {texts[0]!r} in some rows and {texts[1]!r} in "
                    "others; put the columns in one order, or name them with `position` and `torque` in [log]."
                )
            labels += texts
        return tuple(labels) if len(labels) == len(columns) else ()

    def notes(self) -> tuple[str, ...]:
        """Say what was assumed when the columns that are kept were put together, a sentence each."""
        return ()

    def offset(self, name: str) -> int | Fraction:
        """Return the number that was taken off a column of whole numbers, or decimal ones, in the unit of that column.

        `read` and `blocks` take it off so that numbers beyond `LARGEST_EXACT`, as ns since 1970 are, keep all digits.
        It is the same wherever reading begins, and 0 for other columns.
        """
        return 0

    def origin(self, name: str) -> int:
        """Return from when the times of a column in s count that are dates in the file, in ns since 1970; 0 of others.

        It is the same wherever reading begins.
        """
        return 0

    def where(self, row: int) -> str:
        """Say where row `row` (from 0) stands, for messages."""
        return f"row {row + 1}"


def offset_of(first: object) -> int:
    """Return what is taken off whole numbers, by the first of them; see `LogFile.offset`.

    Examples
    --------
    >>> offset_of(1732284307250000000), offset_of(1732284307), offset_of(2**64)
    (1732284307250000000, 0, 0)
    """
    whole = int(first) if isinstance(first, int | np.integer) else 0
    return whole if LARGEST_EXACT <= abs(whole) < 2**63 else 0


def less_offset(whole: NDArray[Any], offset: int) -> NDArray[np.float64]:
    """Return whole numbers less an offset, which is taken off before they are rounded; others where it is 0.

    Examples
    --------
    >>> less_offset(np.array([2**60, 2**60 + 1]), 2**60).tolist()
    [0.0, 1.0]
    """
    return np.asarray(whole.astype(np.int64) - offset if offset else whole, dtype=np.float64)


def column_length(columns: Columns) -> int:
    """Return the number of rows of columns, 0 where there are none."""
    return len(next(iter(columns.values()))) if columns else 0


def regrouped_columns(parts: Iterable[Columns], rows: int, start: int = 0) -> Iterator[Columns]:
    """Cut and join a stream of columns so that each part holds `rows` rows, and the last one the rest.

    The first `start` rows are left out.

    Examples
    --------
    >>> parts = ({"t": np.arange(a, a + 3.0)} for a in range(0, 9, 3))
    >>> [part["t"].tolist() for part in regrouped_columns(parts, 4, 2)]
    [[2.0, 3.0, 4.0, 5.0], [6.0, 7.0, 8.0]]
    """
    held: list[Columns] = []
    size = 0
    for part in parts:
        count = column_length(part)
        begin = min(start, count)
        start -= begin
        while begin < count:
            end = min(count, begin + rows - size)
            held.append({name: values[begin:end] for name, values in part.items()})
            size, begin = size + end - begin, end
            if size == rows:
                yield _below(held)
                held, size = [], 0
    if held:
        yield _below(held)


def _below(parts: Sequence[Columns]) -> Columns:
    if len(parts) == 1:
        return parts[0]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def common_length(path: Path, lengths: Mapping[str, int]) -> int:
    """Return the number of rows of arrays, 0 where there are none.

    Raises
    ------
    InputError
        Where they differ.
    """
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name}: {rows}" for name, rows in lengths.items())
        raise InputError(f"{path} has arrays of different lengths ({listed}); each needs one row per sample.")
    return next(iter(lengths.values()), 0)


def reason_of(error: BaseException) -> str:
    """Return what a library says is wrong, as a part of a sentence.

    Examples
    --------
    >>> reason_of(ValueError("the footer\\nis missing.")), reason_of(OSError(22, "Invalid argument"))
    ('the footer is missing', 'Invalid argument')
    """
    if isinstance(error, MemoryError):
        return "a size that stands in it is larger than the memory"
    said = getattr(error, "strerror", None) or str(error)
    return " ".join(str(said).split())[:200].rstrip(".") or type(error).__name__


@contextlib.contextmanager
def reading_as(path: Path, kind: str, remedy: str = "save it again") -> Iterator[None]:
    """Say in one sentence why a library cannot read a file; in damaged ones they raise whatever they meet.

    Examples
    --------
    >>> with reading_as(Path("run.npz"), "NPZ"):
    ...     raise ValueError("the header is missing")
    Traceback (most recent call last):
    steelyard.errors.InputError: run.npz cannot be read as NPZ: the header is missing; save it again.
    """
    try:
        yield
    except SteelyardError:
        raise
    except Exception as error:
        raise InputError(f"{path} cannot be read as {kind}: {reason_of(error)}; {remedy}.") from None


def flattened(arrays: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return the columns of arrays (S,) and (S, M): the latter under their name and 1 to M."""
    columns: Columns = {}
    for key, array in arrays.items():
        if array.ndim == 1:
            columns[key] = array
        else:
            columns.update({f"{key}{j + 1}": np.ascontiguousarray(array[:, j]) for j in range(array.shape[1])})
    return columns
