"""Logs as NPZ, the archive of NumPy arrays."""

from __future__ import annotations

import contextlib
import math
import struct
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown
from steelyard.files.arrays import read_array_header

from ..column_styles import LABELS
from .array_in_file import ArrayInFile, unpacked
from .dates import LONGEST_DATE, origin_of_dates, origin_of_times, seconds_of_texts, seconds_of_times
from .decoded import decoded_once
from .log_file import Columns, LogFile, common_length, less_offset, offset_of, reading_as

__all__ = ["NpzFile"]

LARGEST_COUNT = 5000  # of arrays, and of columns of an array
MOST_COMPRESSED = 1100  # deflate makes at most 1032 bytes of one; bzip2 and LZMA, which NumPy does not write, make more


@dataclass(frozen=True)
class Member:
    """One array of the archive."""

    file: str
    shape: tuple[int, ...]
    column_major: bool
    kind: np.dtype[Any]
    holds_dates: bool = False
    """Whether the first of its texts is a date."""
    offset: int = 0
    origin: int = 0

    @property
    def is_spread(self) -> bool:
        """Whether the numbers of a row do not stand side by side."""
        return self.column_major and len(self.shape) == 2 and self.shape[1] > 1


class NpzFile(LogFile):
    """An NPZ file: arrays (S,) are columns, arrays (S, M) are M columns named by the array and 1 to M.

    Other arrays are passed over. Nothing pickled is read.
    """

    saved_as = ".npz"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._members: dict[str, Member] = {}
        with self._archive() as archive:
            entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
            if len(entries) > LARGEST_COUNT:
                raise InputError(f"{path} holds {len(entries)} arrays; a log has a few, such as t, q and torque.")
            for entry in entries:
                with archive.open(entry.filename) as stream:
                    member = Member(entry.filename, *read_array_header(stream))
                    member = _with_first(stream, member)
                self._check(member, entry)
                self._members[entry.filename.removesuffix(".npy")] = member
        self._columns = {
            name: place for key, member in self._members.items() for name, place in _column_names(key, member)
        }
        self.names = tuple(self._columns)
        if not self.names:
            raise InputError(f"{path} holds no arrays of numbers (S,) or (S, N); expected t, q and torque.")

    @contextlib.contextmanager
    def _archive(self) -> Iterator[zipfile.ZipFile]:
        """Open the archive; what is wrong with it is said in one sentence."""
        with reading_as(self.path, "NPZ"), zipfile.ZipFile(self.path) as archive:
            yield archive

    def _check(self, member: Member, entry: zipfile.ZipInfo) -> None:
        """Refuse an array that claims more than the file can hold, before anything is done for each of its columns."""
        if entry.file_size > MOST_COMPRESSED * entry.compress_size + 1000:
            raise InputError(
                f"{self.path}: its array {member.file} claims {entry.file_size} bytes, from {entry.compress_size} "
                "compressed ones, which no compression reaches; save it again."
            )
        if not _column_names("", member, 1):
            return
        if math.prod(member.shape) * member.kind.itemsize > entry.file_size:
            raise InputError(
                f"{self.path}: its array {member.file} claims to have the shape {shown(member.shape)}, for which "
                f"its {entry.file_size} bytes are too few; save it again."
            )
        rows, columns = (*member.shape, 1)[:2]
        if columns > LARGEST_COUNT or (columns > 100 and columns > rows):
            raise InputError(
                f"{self.path}: its array {member.file} has the shape {member.shape}; expected one row per sample and "
                "one column per joint: transpose it."
            )

    def joint_labels(self) -> tuple[str, ...]:
        """Return the texts of an array (N,) of joint names."""
        for key in LABELS:
            member = self._members.get(key)
            if member is None or member.kind.kind != "U" or len(member.shape) != 1 or member.shape[0] > LARGEST_COUNT:
                continue
            with self._archive() as archive, archive.open(member.file) as stream:
                return tuple(map(str, np.lib.format.read_array(stream, allow_pickle=False)))
        return ()

    @classmethod
    def write(cls, file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write the arrays as they are."""
        np.savez(file, **arrays)  # type: ignore[arg-type]

    def offset(self, name: str) -> int:
        """See `LogFile.offset`."""
        return self._members[self._columns[name][0]].offset

    def origin(self, name: str) -> int:
        """See `LogFile.origin`."""
        return self._members[self._columns[name][0]].origin

    def count(self) -> int:
        """Number of rows, the length of the longest array."""
        return max(member.shape[0] for key, member in self._members.items() if _column_names(key, member))

    def read(self, names: Sequence[str]) -> Columns:
        """Read whole columns."""
        return next(self.blocks_from(0, names, self._rows(names)), {}) if names else {}

    def blocks_from(self, start: int, names: Sequence[str], rows: int) -> Iterator[Columns]:
        """Read columns in blocks of rows, also from compressed archives and of arrays in Fortran order."""
        keys = dict.fromkeys(self._columns[name][0] for name in names)
        total = self._rows(names)
        with contextlib.ExitStack() as stack:
            archive = stack.enter_context(self._archive())
            stored = {key: self._stored(archive, self._members[key], stack, start) for key in keys}
            for first in range(start, total, rows):
                count = min(rows, total - first)
                block = {key: self._take(array, self._members[key], first, count) for key, array in stored.items()}
                yield {name: self._column(block, name) for name in names}

    def _stored(self, archive: zipfile.ZipFile, member: Member, stack: contextlib.ExitStack, start: int) -> ArrayInFile:
        """Return an array as it stands in the archive, of which rows are read from `start` on.

        Of a compressed one the rows follow each other. Where they do not, because the columns do (Fortran order), it is
        unpacked into a temporary file.
        """
        entry = archive.getinfo(member.file)
        is_stored = entry.compress_type == zipfile.ZIP_STORED
        # Read from the first row on, the archive checks the sum of all bytes. Of what is stored as it is, seeking tells
        # wrong places up to Python 3.12.8 and 3.13.1 (CPython's issue 127847).
        if not member.is_spread and not (is_stored and start):
            stream = stack.enter_context(archive.open(entry))
            read_array_header(stream)
            return ArrayInFile(stream, stream.tell(), member.shape, member.kind, by_columns=False)
        with archive.open(entry) as stream:
            read_array_header(stream)
            if is_stored:
                begin = _begin(self.path, entry) + stream.tell()
                file = stack.enter_context(self.path.open("rb"))
                return ArrayInFile(file, begin, member.shape, member.kind, member.is_spread)
            options = (NpzFile, member.file)
            return decoded_once(self.path, options, lambda: unpacked(stream, member.shape, member.kind, True))

    def _rows(self, names: Sequence[str]) -> int:
        keys = (self._columns[name][0] for name in names)
        return common_length(self.path, {key: self._members[key].shape[0] for key in keys})

    def _take(self, array: ArrayInFile, member: Member, first: int, count: int) -> NDArray[np.float64]:
        try:
            return self._numbers(array.part(first, first + count), member)
        except EOFError:
            raise InputError(
                f"{self.path} is damaged: the array {member.file} ends before its last row; save it again."
            ) from None

    def _numbers(self, values: NDArray[Any], member: Member) -> NDArray[np.float64]:
        if member.kind.kind in "mM":
            return seconds_of_times(values, member.origin)
        if not member.holds_dates:
            return less_offset(values, member.offset)
        seconds = seconds_of_texts(values, member.origin)
        if seconds is None:
            raise InputError(
                f"{self.path}: the texts of its array {member.file} are not all dates of one form; save times as "
                "numbers."
            )
        return seconds

    def _column(self, block: Columns, name: str) -> NDArray[np.float64]:
        key, index = self._columns[name]
        array = block[key]
        return array if array.ndim == 1 else np.ascontiguousarray(array[:, index])


def _begin(path: Path, entry: zipfile.ZipInfo) -> int:
    """Return the byte at which a member begins that is not compressed, behind the header that stands before it."""
    with path.open("rb") as file:
        file.seek(entry.header_offset)
        header = file.read(30)
    name, extra = struct.unpack("<HH", header[26:30])
    return int(entry.header_offset + 30 + name + extra)


def _with_first(stream: IO[bytes], member: Member) -> Member:
    """Return an array with what its first element tells: whether they are dates, and from where they count."""
    kind = member.kind
    if len(member.shape) != 1 or 0 in member.shape or kind.itemsize > 4 * LONGEST_DATE or kind.kind not in "USMiu":
        return member
    data = stream.read(kind.itemsize)
    if len(data) != kind.itemsize:
        return member
    first = np.frombuffer(data, dtype=kind)
    if kind.kind in "iu":
        return replace(member, offset=offset_of(first[0]))
    if kind.kind == "M":
        return replace(member, origin=origin_of_times(first))
    is_date = seconds_of_texts(first) is not None
    return replace(member, holds_dates=is_date, origin=origin_of_dates(first.tolist()) if is_date else 0)


def _column_names(key: str, member: Member, most: int = LARGEST_COUNT) -> list[tuple[str, tuple[str, int]]]:
    is_time = len(member.shape) == 1 and (member.kind.kind in "mM" or member.holds_dates)
    if (member.kind.kind not in "fiu" and not is_time) or 0 in member.shape:
        return []
    if len(member.shape) == 1:
        return [(key, (key, 0))]
    if len(member.shape) == 2:
        return [(f"{key}{index + 1}", (key, index)) for index in range(min(member.shape[1], most))]
    return []
