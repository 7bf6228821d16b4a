"""Logs as MATLAB's files: versions 4 to 7 through SciPy, 7.3 as HDF5."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files.arrays import read_array_header
from steelyard.files.child_process import ChildLimits, run_child
from steelyard.files.writing import kept_folder

from ..columns import LogColumns
from .array_in_file import ArrayInFile
from .array_log import ArrayLog, StoredArray, dates_stored, texts_of
from .decoded import decoded_once, large_files
from .log_file import LogFile, reason_of

__all__ = ["MatFile"]

MEMORY, MEMORY_PER_BYTE = 2**31, 100
"""Limit of the address space, bytes: a constant, and a multiple of the file. Compressed logs grow by a factor of two to
ten, and SciPy holds what it reads twice."""
TIME, TIME_PER_BYTE, LONGEST_TIME = 60, 1e-6, 3600
"""Limit of the processor time, s; a compressed file of 100 MB takes 2 s.
A file of holes may have terabytes."""


class MatFile(ArrayLog):
    """A file of MATLAB of version 4 to 7: arrays, and those in structs, as ``log.q``; cells of texts name joints.

    Another process with limits of memory and time reads it, see `mat_child`.
    """

    joiner = "."

    @classmethod
    def opened(cls, path: Path, columns: LogColumns) -> Self:
        """Open a file; one of version 7.3 is HDF5."""
        with path.open("rb") as file:
            begin = file.read(520)
        if begin.startswith(b"MATLAB 7.3") or b"\x89HDF\r\n\x1a\n" in (begin[:8], begin[512:520]):
            from .hdf5_file import Hdf5File

            other: LogFile = Hdf5File(path)
            return other  # type: ignore[return-value]
        return cls(path)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._content = content = decoded_once(path, MatFile, lambda: _Content(path))
        self._store(content.arrays, content.texts, content.has_objects)


class _Content:
    """The content of a file; its arrays stand in a temporary folder that is removed with this object."""

    def __init__(self, path: Path) -> None:
        folder, _ = kept_folder(self, large_files() / "steelyard-matlab")
        index = _read(path, folder)
        if "problem" in index:
            problem = reason_of(MemoryError()) if index["problem"] == "MemoryError" else index["problem"]
            raise InputError(f"{path} cannot be read as a file of MATLAB: {problem}; save it again.")
        self.arrays = []
        for number, name in enumerate(index["arrays"]):
            array = _stored(folder / f"{number}.npy")
            self.arrays.append(StoredArray.of_numbers(tuple(name), array.shape, partial(_part, array)))
        for number, name in enumerate(index["columns"]):
            texts = np.load(folder / f"text{number}.npy", mmap_mode="r", allow_pickle=False)
            dates = dates_stored(tuple(name), texts)
            self.arrays += [] if dates is None else [dates]
        self.texts = {tuple(name): texts_of(texts) for name, texts in index["texts"]}
        self.has_objects = bool(index["objects"])


def _stored(path: Path) -> ArrayInFile:
    """Return an array that the other process saved."""
    file = path.open("rb")
    shape, by_columns, kind = read_array_header(file)
    return ArrayInFile(file, file.tell(), shape, kind, by_columns).closing()


def _part(array: ArrayInFile, start: int, stop: int, axis: int) -> NDArray[Any]:
    """Return the part start:stop along one axis."""
    return array.part(start, stop, axis)


def _read(path: Path, folder: Path) -> dict[str, Any]:
    """Read a file in another process, and return what it says of it."""
    size = path.stat().st_size
    seconds = min(TIME + TIME_PER_BYTE * size, LONGEST_TIME)
    limits = ChildLimits(3.0 * seconds, int(seconds), MEMORY + MEMORY_PER_BYTE * size)
    program = Path(__file__).with_name("mat_child.py")
    arguments = [str(path.absolute()), str(folder)]
    what = f"{path}: MATLAB's files are read by another process"
    written, code = run_child(program, b"", limits, what, arguments)
    if code is None:
        return {"problem": f"it takes longer than {limits.wait:.0f} s"}
    try:
        found: dict[str, Any] = json.loads(written)
    except ValueError:  # it did not get to the index
        return {"problem": "SciPy ended without an answer, as it does for damaged files"}
    return found
