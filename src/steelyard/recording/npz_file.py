"""Logs as NPZ, the archive of NumPy arrays."""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from steelyard.errors import InputError
from steelyard.recording.log_file import LogFile

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["NpzFile"]


@dataclass(frozen=True)
class Member:
    """One array of the archive."""

    file: str
    shape: tuple[int, ...]
    column_major: bool
    kind: np.dtype[Any]


class NpzFile(LogFile):
    """An NPZ file: arrays (S,) are columns, arrays (S, M) are M columns named by the array and 1 to M.

    Other arrays are passed over. Nothing pickled is read.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._members: dict[str, Member] = {}
        try:
            with zipfile.ZipFile(path) as archive:
                for entry in archive.namelist():
                    if entry.endswith(".npy"):
                        with archive.open(entry) as stream:
                            self._members[entry.removesuffix(".npy")] = Member(entry, *_header(stream))
        except (zipfile.BadZipFile, ValueError, EOFError) as error:
            raise InputError(f"{path} cannot be read as NPZ: {error}.") from None
        self._columns = {
            name: place for key, member in self._members.items() for name, place in _column_names(key, member)
        }
        self.names = tuple(self._columns)
        if not self.names:
            raise InputError(f"{path} holds no arrays of numbers (S,) or (S, N); expected t, q and torque.")

    def count(self) -> int:
        """Number of rows, the length of the longest array."""
        return max(member.shape[0] for key, member in self._members.items() if _column_names(key, member))

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Read whole columns."""
        return next(self.blocks(names, self._rows(names)), {}) if names else {}

    def blocks(self, names: Sequence[str], rows: int) -> Iterator[dict[str, NDArray[np.float64]]]:
        """Read columns in blocks of `rows` rows, also from compressed archives.

        Memory stays that of a block unless an array is stored in Fortran order, which is read whole.
        """
        keys = dict.fromkeys(self._columns[name][0] for name in names)
        total = self._rows(names)
        with contextlib.ExitStack() as stack:
            archive = stack.enter_context(zipfile.ZipFile(self.path))
            streams, whole = {}, {}
            for key in keys:
                member = self._members[key]
                stream = stack.enter_context(archive.open(member.file))
                _header(stream)
                if member.column_major and len(member.shape) == 2:
                    flat = self._take(stream, member, member.shape[0] * member.shape[1])
                    whole[key] = flat.reshape(member.shape, order="F")
                else:
                    streams[key] = stream
            for start in range(0, total, rows):
                taken = min(rows, total - start)
                block = {key: array[start : start + taken] for key, array in whole.items()}
                for key, stream in streams.items():
                    member = self._members[key]
                    width = member.shape[1] if len(member.shape) == 2 else 1
                    block[key] = self._take(stream, member, taken * width).reshape(taken, *member.shape[1:])
                yield {name: self._column(block, name) for name in names}

    def _rows(self, names: Sequence[str]) -> int:
        lengths = {key: self._members[key].shape[0] for key in dict.fromkeys(self._columns[name][0] for name in names)}
        if len(set(lengths.values())) > 1:
            raise InputError(
                f"{self.path} has arrays of different lengths ({', '.join(f'{k}: {n}' for k, n in lengths.items())}); "
                "each needs one row per sample."
            )
        return next(iter(lengths.values()), 0)

    def _take(self, stream: IO[bytes], member: Member, count: int) -> NDArray[np.float64]:
        wanted = count * member.kind.itemsize
        try:
            data = stream.read(wanted)
        except (zipfile.BadZipFile, EOFError, OSError) as error:
            raise InputError(f"{self.path} is damaged at array {member.file}: {error}.") from None
        if len(data) != wanted:
            raise InputError(
                f"{self.path} is damaged: the array {member.file} ends before its last row; save it again."
            )
        return np.frombuffer(data, dtype=member.kind).astype(np.float64)

    def _column(self, block: dict[str, NDArray[np.float64]], name: str) -> NDArray[np.float64]:
        key, index = self._columns[name]
        array = block[key]
        return array if array.ndim == 1 else np.ascontiguousarray(array[:, index])


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(stream)
    return np.lib.format.read_array_header_2_0(stream)


def _column_names(key: str, member: Member) -> list[tuple[str, tuple[str, int]]]:
    if member.kind.kind not in "fiu" or 0 in member.shape:
        return []
    if len(member.shape) == 1:
        return [(key, (key, 0))]
    if len(member.shape) == 2:
        return [(f"{key}{index + 1}", (key, index)) for index in range(member.shape[1])]
    return []
