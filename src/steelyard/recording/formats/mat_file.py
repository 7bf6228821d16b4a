"""Logs as MATLAB's files: versions 4 to 7 through SciPy, 7.3 as HDF5."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from ..columns import LogColumns
from .array_log import ArrayLog, StoredArray, texts_of
from .log_file import LogFile

__all__ = ["MatFile"]

DEEPEST = 20
MOST_ELEMENTS = 1000
"""Of an array of structs, such as the signals of a block of Simulink."""


class MatFile(ArrayLog):
    """A file of MATLAB of version 4 to 7: arrays, and those in structs, as ``log.q``; cells of texts name joints."""

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
        from scipy.io import loadmat

        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # names that stand twice, objects that are not read
                content = loadmat(path, struct_as_record=False, chars_as_strings=True, appendmat=False)
        except Exception as error:  # SciPy raises whatever it meets in a damaged file
            reason = " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
            raise InputError(f"{path} cannot be read as a file of MATLAB: {reason}; save it again.") from None
        arrays: list[StoredArray] = []
        texts: dict[tuple[str, ...], tuple[str, ...]] = {}
        objects: list[str] = []
        for name, value in content.items():
            if name.startswith("__"):
                objects += [] if isinstance(value, str | bytes | list) else [name]
                continue
            for place, array in _arrays((name,), value):
                if isinstance(array, tuple):
                    texts[place] = array
                elif array is None:
                    objects.append(".".join(place))
                else:
                    arrays.append(StoredArray(place, array.shape, partial(_take, array)))
        self._store(arrays, texts)
        if not self.names:
            hint = "; expected a time, positions and torques"
            if objects:
                hint = (
                    " but objects of MATLAB, which only MATLAB reads; save plain arrays, as with "
                    "s = table2struct(T, ToScalar=true); save('run.mat', '-struct', 's')"
                )
            raise InputError(f"{path} holds no arrays of numbers with one row per sample{hint}.")


def _arrays(path: tuple[str, ...], value: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the arrays in a variable, its texts as tuples, and None for each object that cannot be read."""
    if len(path) > DEEPEST:
        return
    kind = type(value).__name__
    if kind == "mat_struct":
        for name in value._fieldnames:
            yield from _arrays((*path, name), getattr(value, name))
    elif kind in ("MatlabOpaque", "MatlabObject", "MatlabFunction"):
        yield path, None
    elif not isinstance(value, np.ndarray) or value.ndim == 0:
        return
    elif value.dtype.kind in "fiub":
        yield path, value
    elif value.dtype.kind == "U":
        yield path, texts_of(value)
    elif value.dtype.kind == "O" and value.size <= MOST_ELEMENTS:
        items = list(value.ravel())
        if all(isinstance(item, np.ndarray) and item.dtype.kind == "U" for item in items):
            yield path, texts_of(["".join(map(str, item.ravel())) for item in items])
            return
        for number, item in enumerate(items, start=1):
            yield from _arrays((*path[:-1], path[-1] if len(items) == 1 else f"{path[-1]}({number})"), item)


def _take(array: NDArray[Any], start: int, stop: int, axis: int) -> NDArray[np.float64]:
    return np.take(array, np.arange(start, stop), axis=axis).astype(np.float64)
