"""The table of the formats of logs; opening and writing files by it, and reading several side by side."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, SteelyardError
from steelyard.extensions import Extensions
from steelyard.files import replaced_file, require_file, shown, tell
from steelyard.files.arguments import closest

from ..columns import LogColumns
from ..recognition import Joints, Layout, find_columns
from .log_file import COMPRESSED, LARGEST_EXACT, TEXTS, Columns, DataFrame, LogFile, column_length

__all__ = [
    "LOG_FORMATS",
    "LogFiles",
    "Source",
    "Table",
    "log_format",
    "open_log",
    "require_unwritten",
    "write_log",
    "written_meanwhile",
    "written_states",
]

Table = LogFile | DataFrame | Mapping[str, Any] | NDArray[Any]
"""A log in memory."""
Source = str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Table
_LOOKED_AT = 5000  # rows at a time of a column of which mostly the first is wanted
MOST_COLUMNS = 5000  # a humanoid's log has some hundreds; a file with far more is no log
REMEDY = "give the path of a log, such as a CSV, a bag or an NPZ file"
STANDARD_INPUT = "-"
"""What stands for the standard input in the place of a path, as ``/dev/stdin`` does."""
_SPOOLED: dict[Path, str] = {}
"""Copies of the standard input and of objects, and what they are called in messages."""


def _checked_format(suffix: str, offered: object) -> type[LogFile]:
    if isinstance(offered, type) and issubclass(offered, LogFile):
        return offered
    raise TypeError(f"expected a class derived from steelyard.recording.LogFile, got {shown(offered)}")


_ROS2_BAG = f"{__package__}.ros2_bag:Ros2Bag"
_CSV, _PARQUET = f"{__package__}.csv_file:CsvFile", f"{__package__}.parquet_file:ParquetFile"
LOG_FORMATS: Extensions[type[LogFile]] = Extensions(
    "log_formats",
    "format of logs",
    {
        **dict.fromkeys((*TEXTS, *COMPRESSED), _CSV),
        **dict.fromkeys(("parquet", "pq"), _PARQUET),
        "npz": f"{__package__}.npz_file:NpzFile",
        **dict.fromkeys(("arrow", "feather", "ipc"), f"{__package__}.arrow_file:ArrowFile"),
        "mat": f"{__package__}.mat_file:MatFile",
        **dict.fromkeys(("h5", "hdf5", "hdf"), f"{__package__}.hdf5_file:Hdf5File"),
        "bag": f"{__package__}.ros1_bag:Ros1Bag",
        "db3": _ROS2_BAG,
        "mcap": f"{__package__}.mcap_file:McapFile",
    },
    _checked_format,
)
"""By the suffix of the files, in lower case and without the dot."""
_SAVED = (".csv", ".parquet", ".npz")


def log_format(suffix: str) -> type[LogFile] | None:
    """Return the format of files with a suffix such as ``".csv"``; None where there is none."""
    return LOG_FORMATS.get(suffix.lower().removeprefix("."))


def write_log(path: Path, arrays: Mapping[str, NDArray[Any]]) -> Path:
    """Write arrays (S,) and (S, M) as a log in the format of the suffix; the file appears whole or not at all.

    Raises
    ------
    InputError
        For a suffix under which no format is saved.
    """
    kind = log_format(path.suffix)
    if kind is None or kind.saved_as != path.suffix.lower():
        raise InputError(
            f"{path} has the suffix {path.suffix!r}; recordings are saved as {', '.join(_SAVED[:-1])} or {_SAVED[-1]}."
        )
    with replaced_file(path) as file:
        kind.write(file, arrays)
    return path


class LogFiles:
    """Files recorded side by side: the columns of all of them, row by row.

    Parameters
    ----------
    source
        A path, a sequence of paths, or paths joined by "+" in one string; or a log in memory.
    columns
        Which column is what, of which some keys say what of a file is read; all by the header by default.

    Raises
    ------
    InputError
        For a missing, empty or unreadable file.
    """

    def __init__(self, source: Source, columns: LogColumns | None = None) -> None:
        given = split_source(source, self)
        opened = [one if isinstance(one, LogFile) else open_log(one, columns or LogColumns()) for one in given]
        self.files = [_in_one_time(file) for file in opened]
        self.stated = next((file.stated for file in self.files if file.stated is not None), None)
        self.columns = self.stated or columns or LogColumns()
        self._count: int | None = None
        self.offsets: dict[str, int | Fraction] = {}
        """What is taken off the columns that make the times; set with the layout, see `layout`."""
        self.name = " + ".join(file.path.name for file in self.files)
        self.names = tuple(dict.fromkeys(name for file in self.files for name in file.names))

    def where(self, row: int) -> str:
        """Say where row `row` (from 0) stands, for messages."""
        return self.files[0].where(row)

    def keep(self, names: Sequence[str]) -> None:
        """Read no other columns than these from now on; see `LogFile.keep`."""
        for file, share in zip(self.files, self._shares(names), strict=True):
            with _reading(file.path):
                file.keep(share)

    def places(self) -> tuple[tuple[tuple[int, int], ...], ...] | None:
        """Return where reading of each file can begin in the middle, see `LogFile.places`; None unless of all."""
        found = [file.places() for file in self.files]
        return None if None in found else tuple(one for one in found if one is not None)

    def use_places(self, places: Sequence[tuple[tuple[int, int], ...]], count: int) -> None:
        """Take note of where reading can begin, as another process told by `places`, and of the number of rows."""
        self._count = count
        for file, own in zip(self.files, places, strict=True):
            file.use_places(own)

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
        self._count = counts[0]
        return counts[0]

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints that the first file which does so names its numbered columns by."""
        return next((labels for file in self.files if (labels := file.joint_labels())), ())

    def layout(self, joints: Joints) -> Layout:
        """Find the columns that hold the motion and the torques of a robot, and read no others from now on.

        Times count from the first row from now on, where they are dates, or whole numbers which in s are more than a
        float64 tells to the ns; `clock_origin` says from when.
        """
        self.offsets = {}
        labels = self.joint_labels()
        found = find_columns(self.names, self.columns, joints, values=self.values, labels=labels, log=self.name)
        offsets = self._first_stamps(found)
        self.keep(found.names)
        self.offsets = offsets
        notes: list[str] = []
        for file in self.files:
            with _reading(file.path):
                notes += file.notes()
        return replace(found, guesses=(*found.guesses, *notes)) if notes else found

    def _first_stamps(self, layout: Layout) -> dict[str, int | Fraction]:
        """Return what is to be taken off the columns that make the times; 0 where nothing is gained by it."""
        taken = {name: self.offset(name) for name in layout.stamps}
        if any(taken.values()) or (layout.time_unit == "s" and layout.time_rest is None):
            return taken  # numbers of s with a fraction have lost what a float64 does not hold
        first = next(self.blocks(layout.stamps, _LOOKED_AT), {})
        raw = {name: float(first[name][0]) for name in layout.stamps if len(first.get(name, ()))}
        if raw and all(number.is_integer() for number in raw.values()):
            whole: dict[str, int | Fraction] = {name: int(number) for name, number in raw.items()}
            if abs(layout.nanoseconds(whole)) >= LARGEST_EXACT:
                return whole
        return taken

    def offset(self, name: str) -> int | Fraction:
        """Return what is taken off a column; see `LogFile.offset`."""
        if name in self.offsets:
            return self.offsets[name]
        return next((file.offset(name) for file in self.files if name in file.names), 0)

    def origin(self, name: str) -> int:
        """Return from when a column of dates counts; see `LogFile.origin`."""
        return next((file.origin(name) for file in self.files if name in file.names), 0)

    def clock_origin(self, layout: Layout) -> int:
        """Return where on the clock of the log its times are 0, in ns: since 1970 where the log tells; 0 otherwise."""
        if layout.time is None:
            return 0
        return self.origin(layout.time) + layout.nanoseconds(self.offsets)

    def values(self, name: str) -> Iterator[NDArray[np.float64]]:
        """Return the values of a column, in blocks."""
        for block in self.blocks([name], _LOOKED_AT):
            yield block[name]

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns from whichever file has them."""
        shares = self._shares(names)
        parts = []
        for file, share in zip(self.files, shares, strict=True):
            with _reading(file.path):
                parts.append(self._counted(file, _checked(file, file.read(share), share)))
        counts = [column_length(part) for part in parts if part]
        self._require_equal(counts)
        if counts[0] == 0:
            raise InputError(f"{self.name} holds no rows; expected one row per sample under the column names.")
        return self._joined(names, parts)

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of `rows` rows; all the files advance together."""
        return self.blocks_from(0, names, rows)

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of `rows` rows, from row `start` (from 0) on; all the files advance together."""
        shares = [(file, share) for file, share in zip(self.files, self._shares(names), strict=True) if share]
        streams = [
            map(partial(self._counted, file), _checked_blocks(file, share, rows, start)) for file, share in shares
        ]
        what = f"reading {self.name}" if len(names) > 1 else f"looking through {names[0]!r} of {self.name}"
        done = start
        for parts in zip(*streams, strict=True):
            self._require_equal([column_length(part) for part in parts])
            tell(what, done, self._count, "rows")
            yield self._joined(names, parts)
            done += column_length(parts[0])

    def _counted(self, file: LogFile, columns: Columns) -> Columns:
        """Return columns of a file as they count here: those that make the times from the first row, others from 0."""
        for name in columns:
            if shift := file.offset(name) - self.offsets.get(name, 0):
                columns[name] = columns[name] + float(shift)
        return columns

    def _shares(self, names: Sequence[str]) -> list[list[str]]:
        """Return which of `names` is read from which file; a column that several files have is read from each."""
        return [[name for name in names if name in file.names] for file in self.files]

    def _joined(self, names: Sequence[str], parts: Sequence[Columns]) -> Columns:
        columns: Columns = {}
        for name in names:
            copies = [part[name] for part in parts if name in part]
            origins = {file.origin(name) for file in self.files if name in file.names} if len(copies) > 1 else {0}
            if len(origins) > 1 or any(not np.array_equal(copies[0], copy, equal_nan=True) for copy in copies[1:]):
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
    except SteelyardError as error:
        if path in _SPOOLED:  # of which the user knows nothing
            raise type(error)(str(error).replace(str(path), _SPOOLED[path])) from None
        raise
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror or error}); {REMEDY}.") from None
    except Exception as error:
        if isinstance(error, MemoryError) or "can't start new thread" in str(error):
            raise InputError(
                f"{path} cannot be read: there is not enough memory for what it says it holds; save it again, or allow "
                "the process more."
            ) from None
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


def _in_one_time(file: LogFile) -> LogFile:
    """Return a log with its episodes, if it has some, one after the other in time."""
    if "episode_index" not in file.names:
        return file
    from .episodes import with_episodes_apart  # what is not asked for is not loaded

    with _reading(file.path):
        return with_episodes_apart(file)


def _checked_blocks(file: LogFile, names: Sequence[str], rows: int, start: int) -> Iterator[Columns]:
    with _reading(file.path):
        for block in file.blocks_from(start, names, rows):
            yield _checked(file, block, names)


def split_source(source: Source, holder: object = None) -> list[Path | LogFile]:
    """Return the paths that `source` stands for; a string with "+" is several, unless a file has that very name.

    Copies of objects stay there as long as `holder`, which reads them.
    """
    if isinstance(source, LogFile):
        return [source]
    if isinstance(source, (str, os.PathLike)):
        text = os.fspath(source)
        if text == "/dev/stdin":
            return [Path(STANDARD_INPUT)]
        if "://" in text:
            from .remote import local_copy  # what is not asked for is not loaded

            copy = local_copy(text, holder)
            _SPOOLED[copy] = text
            return [copy]
        if "+" in text and not os.path.exists(text):
            pieces = [piece.strip() for piece in text.split("+")]
            if all(pieces):
                return [Path(piece) for piece in pieces]
        return [Path(text)]
    if isinstance(source, (list, tuple)) and all(isinstance(one, (str, os.PathLike)) for one in source):
        if not source:
            raise InputError(f"no log file was given; {REMEDY}.")
        return [path for one in source for path in (split_source(one, holder) if "://" in str(one) else [Path(one)])]
    from .memory import memory_log  # what is not asked for is not loaded

    return [memory_log(source, "data")]


def written_states(logs: Iterable[object]) -> dict[str, Hashable]:
    """Return for each log that is files of this machine what changes when one of them is written."""
    return {log: _written(log) for log in logs if isinstance(log, str) and "://" not in log}


def require_unwritten(before: Mapping[str, Hashable]) -> None:
    """Make sure that no log was written since `written_states` was asked; what was removed meanwhile, was read.

    Logs are read several times: rows of two contents would come together, and the hash of the second would be recorded.

    Raises
    ------
    InputError
        If one was.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log.csv"
    >>> _ = path.write_text("t,q1,tau1")
    >>> require_unwritten(written_states([str(path)]))
    """
    for log, state in before.items():
        if _written(log) not in (state, None):
            raise written_meanwhile(log)


def written_meanwhile(log: str) -> InputError:
    """Return what is said of a log that was not the same from the first time it was read to the last."""
    return InputError(
        f"{log} was written while it was read, as are logs of a robot that still moves; wait until it is "
        "complete, or copy it, and run again."
    )


def _written(log: str) -> Hashable:
    from .decoded import written_state  # what is not asked for is not loaded

    try:
        return tuple(written_state(path) for path in split_source(log) if isinstance(path, Path))
    except OSError:
        return None


def open_log(path: Path, columns: LogColumns | None = None) -> LogFile:
    """Open a log by its suffix; keys of `columns` may say what of the file is read.

    Raises
    ------
    InputError
        For a file that is missing, empty, of another kind or unreadable.
    """
    if "\0" in str(path):
        raise InputError(f"{shown(str(path))} is not a valid path; {REMEDY}.")
    if str(path) == STANDARD_INPUT:
        from .standard_input import standard_input

        path = standard_input()
        _SPOOLED[path] = "the standard input"
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path} does not exist{_neighbour(path)}; {REMEDY}.") from None
    except OSError:
        require_file(path, REMEDY)  # says why
    if path.is_fifo():
        raise InputError(
            f"{path} is a pipe, which can be read only once; pipe it into the command and give {STANDARD_INPUT} in the "
            "place of its path."
        )
    is_bag = path.is_dir() and (path / "metadata.yaml").is_file()
    if path.is_dir() and not is_bag:
        raise InputError(f"{path} is a folder, and no bag of ROS 2 (no metadata.yaml); give the log file itself.")
    kind = log_format(".db3" if is_bag else path.suffix)
    if kind is None:
        known = ", ".join(f".{suffix}" for suffix in LOG_FORMATS.names())
        reduced = " What `steelyard reduce` wrote is data of a fit." if path.suffix.lower() == ".json" else ""
        raise InputError(f"{path} has the suffix {path.suffix!r}; logs are read from {known}.{reduced}")
    if not is_bag:
        require_file(path, REMEDY)
    inner = Path(path.stem).suffix
    if path.suffix.lower().removeprefix(".") in COMPRESSED and log_format(inner) not in (kind, None):
        raise InputError(f"{path} is compressed, and of compressed files only texts are read; decompress it.")
    with _reading(path):
        if not is_bag and path.stat().st_size == 0:
            raise InputError(f"{path} is empty; expected a log with one row per sample.")
        log = kind.opened(path, LogColumns() if columns is None else columns)
    if len(log.names) > MOST_COLUMNS:
        raise InputError(f"{path} has {len(log.names)} columns; expected one for each signal of a robot, in rows.")
    return log


def _neighbour(path: Path) -> str:
    if path.is_symlink():
        return f", as it is a link to {os.readlink(path)}"
    if not path.parent.is_dir():
        return f" (nor does its folder {path.parent})"
    near = None
    with contextlib.suppress(OSError):  # nobody may list the folder
        near = closest(path.name, os.listdir(path.parent))
    return f' (did you mean "{near}"?)' if near else ""
