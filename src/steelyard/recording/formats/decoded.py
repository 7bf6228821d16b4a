"""Files that are expensive to decode, kept decoded for whoever reads them again."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from pathlib import Path
from threading import Lock
from typing import IO, Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from steelyard.files.advance import ahead

from .log_file import Columns, column_length, regrouped_columns

__all__ = ["DecodedColumns", "decoded_once", "large_files", "written_state"]

IN_MEMORY = 32_000_000
"""Bytes of decoded columns that stay in memory; a longer log goes to a temporary file."""
STORED_ROWS = 25_000
"""Rows of a block in that file, in which each column is contiguous: those that are wanted are read alone."""

MOST_DECODED = 4
"""Files that stay decoded, in temporary files: an identification opens its log two times or more. Decoding takes 30 to
90 µs a message of a bag, 1.4 µs a date of an HDF5 file, 0.6 µs a row of fifteen columns of CSV, which are written and
read again in 0.1 µs, and another process for a file of MATLAB."""
Decoded = TypeVar("Decoded")
_DECODED: dict[Hashable, Any] = {}


def decoded_once(path: Path, options: Hashable, decode: Callable[[], Decoded]) -> Decoded:
    """Return what `decode` makes of a file, or made of it as long as the file, or one in the folder, is not written.

    Parameters
    ----------
    path : Path
        A file or folder.
    options : hashable
        What else the outcome depends on.
    decode : callable
        Its outcome is used by several, none of which changes it.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "log.txt"
    >>> for text in ("one", "one", "three"):
    ...     _ = path.write_text(text) if not path.exists() or path.read_text() != text else None
    ...     decoded_once(path, "lengths", lambda: print("decoding") or len(path.read_text()))
    decoding
    3
    3
    decoding
    5
    """
    # A forked process decodes anew: it would share the places at which files of its parent are read.
    key = (os.getpid(), str(path), options, written_state(path))
    found = _DECODED.get(key)
    if found is None:
        found = _DECODED[key] = decode()
        for oldest in list(_DECODED)[:-MOST_DECODED]:
            _DECODED.pop(oldest, None)  # unless another thread did
    return cast("Decoded", found)


def written_state(path: Path) -> Hashable:
    """Return what changes when a file, or one in a folder, is written again."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return tuple((file.name, status.st_size, status.st_mtime_ns) for file in files for status in [file.stat()])


class DecodedColumns:
    """Columns of a log that was decoded once, in memory or, where they are many, in a temporary file.

    The file has no name, so that nothing is left of it whatever ends the process. Where there is no room for it the log
    is decoded again whenever it is read. What decodes the log yields its columns, part by part.

    Examples
    --------
    >>> parts = [{"t": np.arange(5.0), "q": np.ones(5)}, {"t": np.arange(5.0, 7.0), "q": np.zeros(2)}]
    >>> decoded = DecodedColumns(["t", "q"], lambda: iter(parts))
    >>> decoded.count, [block["t"].tolist() for block in decoded.blocks(1, ["t"], 4)]
    (7, [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0]])
    """

    def __init__(self, names: Sequence[str], decode: Callable[[], Iterable[Columns]]) -> None:
        self.names = tuple(names)
        self.count = 0
        self._decode = decode
        self._held: list[Sequence[NDArray[np.float64]]] | None = []
        self._file: IO[bytes] | None = None
        self._lock = Lock()
        # Some are written while others are decoded.
        for block in regrouped_columns(ahead(decode(), 1), STORED_ROWS):
            self.count += column_length(block)
            self._store([np.ascontiguousarray(block[name], dtype=np.float64) for name in self.names])

    def _store(self, block: Sequence[NDArray[np.float64]]) -> None:
        if self._held is None and self._file is None:  # there is no room
            return
        try:
            if self._file is not None:
                _write(self._file, block)
                return
            assert self._held is not None
            self._held.append(block)
            if len(self._held) * sum(column.nbytes for column in self._held[0]) > IN_MEMORY:
                held, self._held = self._held, None
                self._file = tempfile.TemporaryFile(prefix="steelyard-", dir=large_files(), buffering=0)  # noqa: SIM115
                weakref.finalize(self, self._file.close)
                for one in held:
                    _write(self._file, one)
        except OSError:
            self._held = self._file = None

    def blocks(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns from row `start` on in blocks of `rows` rows."""
        if self._held is None and self._file is None:
            parts, first = iter(self._decode()), 0
        else:
            first = start // STORED_ROWS * STORED_ROWS
            parts = self._stored(first // STORED_ROWS, [self.names.index(name) for name in names])
        return regrouped_columns(({name: part[name] for name in names} for part in parts), rows, start - first)

    def _stored(self, block: int, places: Sequence[int]) -> Iterator[Columns]:
        for first in range(block * STORED_ROWS, self.count, STORED_ROWS):
            count = min(STORED_ROWS, self.count - first)
            if self._held is not None:
                taken = [self._held[first // STORED_ROWS][place] for place in places]
            else:
                taken = self._read(first * len(self.names), count, places)
            yield {self.names[place]: column for place, column in zip(places, taken, strict=True)}

    def _read(self, first: int, count: int, places: Sequence[int]) -> list[NDArray[np.float64]]:
        """Read columns of `count` numbers each, of which the first begins at number `first` of the file."""
        assert self._file is not None
        with self._lock:
            if 2 * len(places) > len(self.names):
                whole = np.empty((len(self.names), count))
                self._fill(whole, first)
                return [whole[place] for place in places]
            columns = [np.empty(count) for _ in places]
            for column, place in zip(columns, places, strict=True):
                self._fill(column, first + place * count)
            return columns

    def _fill(self, array: NDArray[np.float64], first: int) -> None:
        assert self._file is not None
        self._file.seek(8 * first)
        data = array.data.cast("B")
        while len(data):
            taken = self._file.readinto(data)  # type: ignore[attr-defined]
            if not taken:
                raise OSError("a temporary file with decoded columns became shorter")
            data = data[taken:]


def _write(file: IO[bytes], block: Sequence[NDArray[np.float64]]) -> None:
    for column in block:  # put together, they would be copied once more
        data = column.data.cast("B")
        while len(data):
            data = data[file.write(data) :]


def large_files() -> Path:
    """Return where large temporary files go: `/tmp` may be a part of the memory, `/var/tmp` never is."""
    if not os.environ.get("TMPDIR") and os.access("/var/tmp", os.W_OK | os.X_OK):
        return Path("/var/tmp")
    return Path(tempfile.gettempdir())
