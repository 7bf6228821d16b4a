"""Log files: named columns of numbers, read whole or in blocks of rows."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from steelyard.errors import InputError
from steelyard.files import require_file, shown

from ..header import label_columns

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Columns = dict[str, NDArray[np.float64]]

__all__ = ["BLOCK_ROWS", "LogFile", "LogFiles", "open_log"]

MOST_COLUMNS = 5000

BLOCK_ROWS = 50_000
"""Rows that are read at a time where not all are wanted in memory."""


class LogFile(ABC):
    """One file: its columns by name, each a float64 array (S,); missing values are NaN."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.names: tuple[str, ...] = ()

    @abstractmethod
    def count(self) -> int:
        """Number of rows."""

    @abstractmethod
    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""

    @abstractmethod
    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns from the first row to the last, `rows` rows at a time."""

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

    def ends(self, name: str) -> tuple[float, float]:
        """First and last value of a column."""
        first = last = float("nan")
        for index, block in enumerate(self.blocks([name], BLOCK_ROWS)):
            first = float(block[name][0]) if index == 0 else first
            last = float(block[name][-1])
        return first, last

    def where(self, row: int) -> str:
        """Say where row `row` (from 0) stands, for messages."""
        return f"row {row + 1}"


class LogFiles:
    """Files recorded side by side: the columns of all of them, row by row.

    Parameters
    ----------
    source
        A path, a sequence of paths, or paths joined by "+" in one string.

    Raises
    ------
    InputError
        For a missing, empty or unreadable file.
    """

    def __init__(self, source: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> None:
        self.files = [open_log(path) for path in split_source(source)]
        self.name = " + ".join(file.path.name for file in self.files)
        self.names = tuple(dict.fromkeys(name for file in self.files for name in file.names))

    def where(self, row: int) -> str:
        """Say where row `row` (from 0) stands, for messages."""
        return self.files[0].where(row)

    def count(self) -> int:
        """Count the rows.

        Raises
        ------
        InputError
            Where the files differ in length.
        """
        counts = [file.count() for file in self.files]
        self._require_equal(counts)
        return counts[0]

    def ends(self, name: str) -> tuple[float, float]:
        """First and last value of a column."""
        return next(file for file in self.files if name in file.names).ends(name)

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints that the first file which does so names its numbered columns by."""
        return next((labels for file in self.files if (labels := file.joint_labels())), ())

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns from whichever file has them."""
        shares = self._shares(names)
        parts = [file.read(share) for file, share in zip(self.files, shares, strict=True)]
        counts = [_length(part) for part in parts if part]
        self._require_equal(counts)
        if counts[0] == 0:
            raise InputError(f"{self.name} holds no rows; expected one row per sample under the column names.")
        return self._joined(names, parts)

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of `rows` rows; all the files advance together."""
        shares = self._shares(names)
        streams = [file.blocks(share, rows) for file, share in zip(self.files, shares, strict=True) if share]
        for parts in zip(*streams, strict=True):
            self._require_equal([_length(part) for part in parts])
            yield self._joined(names, parts)

    def _shares(self, names: Sequence[str]) -> list[list[str]]:
        """Which of `names` is read from which file; a column that several files have is read from each."""
        return [[name for name in names if name in file.names] for file in self.files]

    def _joined(self, names: Sequence[str], parts: Sequence[Columns]) -> Columns:
        columns: Columns = {}
        for name in names:
            copies = [part[name] for part in parts if name in part]
            if any(not np.array_equal(copies[0], copy, equal_nan=True) for copy in copies[1:]):
                raise InputError(
                    f"the column {name!r} is in several of the files {self.name} with different values; "
                    "rename it in one of them, or record them side by side again."
                )
            columns[name] = copies[0]
        return columns

    def _require_equal(self, counts: Sequence[int]) -> None:
        if len(set(counts)) > 1:
            raise InputError(
                f"the files {self.name} have {', '.join(map(str, counts))} rows; "
                "files read side by side need as many each."
            )


def split_source(source: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Return the paths that `source` stands for; a string with "+" is several, unless a file has that very name."""
    if isinstance(source, (str, os.PathLike)):
        text = os.fspath(source)
        if "+" in text and not Path(text).exists():
            pieces = [piece.strip() for piece in text.split("+")]
            if all(pieces):
                return [Path(piece) for piece in pieces]
        return [Path(text)]
    paths = [Path(os.fspath(path)) for path in source]
    if not paths:
        raise InputError("no log file was given; give the path of a CSV, Parquet or NPZ file.")
    return paths


def open_log(path: Path) -> LogFile:
    """Open a log by its suffix: .parquet or .pq, .npz, and text (CSV) for .csv, .txt, .tsv, .dat or .log.

    Raises
    ------
    InputError
        For a file that is missing, empty, of another kind or unreadable.
    """
    from .csv_file import CsvFile
    from .npz_file import NpzFile
    from .parquet_file import ParquetFile

    if "\0" in str(path):
        raise InputError(f"{shown(str(path))} is no path that can exist; give the path of a CSV, Parquet or NPZ file.")
    if path.is_dir():
        raise InputError(f"{path} is a folder; give the log file itself.")
    if not path.exists():
        raise InputError(f"{path} does not exist{_neighbour(path)}; give the path of a CSV, Parquet or NPZ file.")
    kinds: dict[str, type[LogFile]] = {
        **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".log"), CsvFile),
        **dict.fromkeys((".parquet", ".pq"), ParquetFile),
        ".npz": NpzFile,
    }
    kind = kinds.get(path.suffix.lower())
    if kind is None:
        raise InputError(f"{path} has the suffix {path.suffix!r}; logs are read from {', '.join(kinds)}.")
    require_file(path, "give the path of a CSV, Parquet or NPZ file")
    try:
        if path.stat().st_size == 0:
            raise InputError(f"{path} is empty; expected a log with one row per sample.")
        log = kind(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    if len(log.names) > MOST_COLUMNS:
        raise InputError(f"{path} has {len(log.names)} columns; expected one for each signal of a robot, in rows.")
    return log


def _neighbour(path: Path) -> str:
    from ..section import suggestion

    if not path.parent.is_dir():
        return f" (nor does its folder {path.parent})"
    near = suggestion(path.name, [other.name for other in path.parent.iterdir()])
    return f" ({near.strip()})" if near else ""


def _length(columns: Columns) -> int:
    return next(iter(columns.values())).shape[0] if columns else 0
