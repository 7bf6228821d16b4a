"""The table of the formats of logs; opening and writing files by it, and reading several side by side."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import replaced_file, require_file, shown
from steelyard.files.suggestion import closest

from .csv_file import CsvFile
from .log_file import Columns, LogFile, column_length
from .npz_file import NpzFile
from .parquet_file import ParquetFile

__all__ = ["LogFiles", "Source", "log_format", "open_log", "register_log_format", "write_log"]

Source = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
MOST_COLUMNS = 5000
REMEDY = "give the path of a CSV, Parquet or NPZ file"
GROUP = "steelyard.log_formats"
"""The group of entry points by which installed packages add formats."""
FORMATS: list[type[LogFile]] = [CsvFile, ParquetFile, NpzFile]


def register_log_format(kind: type[LogFile]) -> type[LogFile]:
    """Add a format of logs to those that are read; it may stand above a class as a decorator.

    A package that is installed need not call this: it names its class in the group of entry points
    ``steelyard.log_formats``.

    Raises
    ------
    InputError
        Where the class is no `LogFile`, names no suffix, or one that another format has.

    Examples
    --------
    >>> import numpy as np, pathlib, tempfile
    >>> from steelyard.recording import LogFile, Recording, register_log_format
    >>> @register_log_format
    ... class BinaryLog(LogFile):
    ...     suffixes = (".f64",)
    ...
    ...     def __init__(self, path):
    ...         super().__init__(path)
    ...         self.names = ("t", "q1", "tau1")
    ...
    ...     def read(self, names):
    ...         rows = np.fromfile(self.path).reshape(-1, 3)
    ...         return {name: rows[:, self.names.index(name)] for name in names}
    >>> t = np.arange(300) / 100
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "log.f64"
    >>> np.column_stack([t, np.sin(t), np.cos(t)]).tofile(path)
    >>> Recording.read(path)
    Recording('log.f64', 300 rows x 1 joints, 2.99 s at 100 Hz)
    """
    if not (isinstance(kind, type) and issubclass(kind, LogFile)):
        raise InputError(f"{shown(kind)} is no format of logs; derive a class from steelyard.recording.LogFile.")
    suffixes = getattr(kind, "suffixes", ())
    if not suffixes or any(not suffix.startswith(".") or suffix != suffix.lower() for suffix in suffixes):
        raise InputError(
            f"the format {kind.__name__} has the suffixes {shown(suffixes)}; give one at least, in lower case and with "
            'a dot, such as (".mat",).'
        )
    for other in FORMATS:
        both = [suffix for suffix in suffixes if suffix in other.suffixes]
        if both and not _same(kind, other):
            raise InputError(f"the formats {kind.__name__} and {other.__name__} both claim {both[0]}; leave one out.")
    FORMATS[:] = [other for other in FORMATS if not _same(kind, other)]  # as when a notebook's cell is run again
    FORMATS.append(kind)
    return kind


def _same(kind: type[LogFile], other: type[LogFile]) -> bool:
    return (kind.__module__, kind.__qualname__) == (other.__module__, other.__qualname__)


def log_format(suffix: str) -> type[LogFile] | None:
    """Return the format of files with a suffix; packages that add formats are asked where none of ours has it."""
    for kind in FORMATS:
        if suffix.lower() in kind.suffixes:
            return kind
    _load_installed()
    return next((kind for kind in FORMATS if suffix.lower() in kind.suffixes), None)


def _load_installed() -> None:
    """Register the formats of all installed packages, once."""
    for entry in entry_points(group=GROUP):
        try:
            kind = entry.load()
        except Exception as error:  # another package may raise anything
            package = entry.dist.name if entry.dist is not None else entry.value
            raise InputError(
                f"the format of logs {entry.name!r}, which the package {package} adds, cannot be loaded: "
                f"{type(error).__name__}: {error}; mend that package or uninstall it."
            ) from None
        if kind not in FORMATS:
            register_log_format(kind)


def _suffixes() -> list[str]:
    """Return the suffixes of all formats that are known."""
    return [suffix for kind in FORMATS for suffix in kind.suffixes]


def write_log(path: Path, arrays: Mapping[str, NDArray[np.float64]]) -> Path:
    """Write arrays (S,) and (S, M) as a log in the format of the suffix; the file appears whole or not at all.

    Raises
    ------
    InputError
        For a suffix under which no format is saved.
    """
    kind = log_format(path.suffix)
    if kind is None or kind.saved_as != path.suffix.lower():
        saved = [kind.saved_as for kind in FORMATS if kind.saved_as is not None]
        raise InputError(
            f"{path} has the suffix {path.suffix!r}; recordings are saved as {', '.join(saved[:-1])} or {saved[-1]}."
        )
    with replaced_file(path) as file:
        kind.write(file, arrays)
    return path


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

    def __init__(self, source: Source) -> None:
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
        counts = []
        for file in self.files:
            with _reading(file.path):
                counts.append(file.count())
        self._require_equal(counts)
        return counts[0]

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints that the first file which does so names its numbered columns by."""
        return next((labels for file in self.files if (labels := file.joint_labels())), ())

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns from whichever file has them."""
        shares = self._shares(names)
        parts = []
        for file, share in zip(self.files, shares, strict=True):
            with _reading(file.path):
                parts.append(_checked(file, file.read(share), share))
        counts = [column_length(part) for part in parts if part]
        self._require_equal(counts)
        if counts[0] == 0:
            raise InputError(f"{self.name} holds no rows; expected one row per sample under the column names.")
        return self._joined(names, parts)

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of `rows` rows; all the files advance together."""
        shares = self._shares(names)
        streams = [_checked_blocks(file, share, rows) for file, share in zip(self.files, shares, strict=True) if share]
        for parts in zip(*streams, strict=True):
            self._require_equal([column_length(part) for part in parts])
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


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Say in one sentence why a file cannot be read; formats that other packages add may raise anything."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path} cannot be read ({type(error).__name__}: {reason}); mend the file.") from error


def _checked(file: LogFile, columns: Columns, names: Sequence[str]) -> Columns:
    """Return columns as a format must give them, float64 and of one length; ours do, others may not."""
    checked = {name: np.asarray(columns[name], dtype=np.float64) for name in names}
    shapes = {values.shape for values in checked.values()}
    if len(shapes) > 1 or any(len(shape) != 1 for shape in shapes):
        raise InputError(
            f"{file.path}: its format, {type(file).__name__}, gave columns of the shapes "
            f"{', '.join(map(str, sorted(shapes)))}; expected one value for each row in each of them."
        )
    return checked


def _checked_blocks(file: LogFile, names: Sequence[str], rows: int) -> Iterator[Columns]:
    with _reading(file.path):
        for block in file.blocks(names, rows):
            yield _checked(file, block, names)


def split_source(source: Source) -> list[Path]:
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
        raise InputError(f"no log file was given; {REMEDY}.")
    return paths


def open_log(path: Path) -> LogFile:
    """Open a log by its suffix.

    Raises
    ------
    InputError
        For a file that is missing, empty, of another kind or unreadable.
    """
    if "\0" in str(path):
        raise InputError(f"{shown(str(path))} is no path that can exist; {REMEDY}.")
    if path.is_dir():
        raise InputError(f"{path} is a folder; give the log file itself.")
    if not path.exists():
        raise InputError(f"{path} does not exist{_neighbour(path)}; {REMEDY}.")
    kind = log_format(path.suffix)
    if kind is None:
        raise InputError(f"{path} has the suffix {path.suffix!r}; logs are read from {', '.join(_suffixes())}.")
    require_file(path, REMEDY)
    with _reading(path):
        if path.stat().st_size == 0:
            raise InputError(f"{path} is empty; expected a log with one row per sample.")
        log = kind(path)
    if len(log.names) > MOST_COLUMNS:
        raise InputError(f"{path} has {len(log.names)} columns; expected one for each signal of a robot, in rows.")
    return log


def _neighbour(path: Path) -> str:
    if not path.parent.is_dir():
        return f" (nor does its folder {path.parent})"
    near = closest(path.name, [other.name for other in path.parent.iterdir()])
    return f' (did you mean "{near}"?)' if near else ""
