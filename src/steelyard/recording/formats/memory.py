"""Logs that are in memory already: mappings of arrays, structured arrays, data frames and recordings."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import shown

from ..column_styles import LABELS
from ..columns import LogColumns
from ..measurements import Measurements
from .data_frames import frame_arrays, is_frame
from .dates import origin_of_dates, origin_of_times, seconds_of_texts, seconds_of_times
from .log_file import Columns, LogFile, flattened, less_offset, offset_of

__all__ = ["MemoryLog", "is_table", "memory_log"]

REMEDY = 'give a mapping such as {"t": t, "q": q, "tau": tau}, a data frame with named columns, or a sy.Recording'


class MemoryLog(LogFile):
    """Named columns in memory, read as those of a file are.

    Parameters
    ----------
    columns : mapping
        (S,) arrays by name.
    name : str
        What messages and results call it.
    labels : sequence of str
        The joints of numbered columns, in their order; empty where that is not told.
    stated : LogColumns, optional
        Which column is what, where that is known and no matter of the robot file.
    texts : mapping
        The texts in columns of texts, each once.
    offsets, origins : mapping
        What `LogFile.offset` and `LogFile.origin` return, where it is not 0.

    Examples
    --------
    >>> memory_log({"t": [0.0, 0.1], "q": [[1, 2], [3, 4]]}, "data").names
    ('t', 'q1', 'q2')
    """

    def __init__(
        self,
        columns: Columns,
        name: str,
        labels: Sequence[str] = (),
        stated: LogColumns | None = None,
        texts: Mapping[str, set[str]] | None = None,
        offsets: Mapping[str, int] | None = None,
        origins: Mapping[str, int] | None = None,
    ) -> None:
        super().__init__(Path(name))
        self._offsets, self._origins = dict(offsets or {}), dict(origins or {})
        self._columns, self._labels, self._texts = columns, tuple(labels), dict(texts or {})
        self.stated = stated
        self.names = (*columns, *self._texts)

    def __str__(self) -> str:
        return str(self.path)

    def read(self, names: Sequence[str]) -> Columns:
        """Return whole columns."""
        for name in names:
            if name in self._texts:
                found = next(iter(self._texts[name]), "")
                raise InputError(f"{self} holds {shown(found)} in column {name!r}; expected numbers.")
        return {name: self._columns[name] for name in names}

    def offset(self, name: str) -> int | Fraction:
        """See `LogFile.offset`."""
        return self._offsets.get(name, 0)

    def origin(self, name: str) -> int:
        """See `LogFile.origin`."""
        return self._origins.get(name, 0)

    def joint_labels(self) -> tuple[str, ...]:
        """Return the joints of numbered columns, where a list or columns of their names tell."""
        return self._labels or super().joint_labels()

    def texts(self, names: Sequence[str]) -> dict[str, set[str]]:
        """Texts that stand in columns, each once; none for columns of numbers."""
        return {name: self._texts.get(name, set()) for name in names}

    def digest(self) -> str:
        """Return the SHA-256 hash of names and values, by which one can tell whether data is the same."""
        told = hashlib.sha256()
        for name, values in self._columns.items():
            told.update(f"{name}\0{len(values)}\0".encode())
            if begin := (self.offset(name) or self.origin(name)):
                told.update(f"{begin}\0".encode())
            told.update(np.ascontiguousarray(values, dtype="<f8").data)
        return told.hexdigest()


def is_table(data: object) -> bool:
    """Tell whether data is one log in memory, rather than a path or several logs."""
    named = isinstance(data, np.ndarray) and data.dtype.names is not None
    return named or isinstance(data, (Mapping, Measurements, LogFile)) or is_frame(data)


def memory_log(data: object, name: str) -> LogFile:
    """Return data in memory as a log.

    Parameters
    ----------
    data : mapping, structured array, data frame or Recording
        Arrays (S,) are columns, arrays (S, M) are M columns with the name and 1 to M behind it, as in an NPZ file. A
        list of strings under ``joint_names`` names the joints of numbered columns.
    name : str
        What messages call it.

    Raises
    ------
    InputError
        If it has no named columns of numbers, or columns of different lengths.
    """
    if isinstance(data, LogFile):
        return data
    if isinstance(data, Measurements):
        return _recorded(data, name)
    if isinstance(data, np.ndarray):
        if data.dtype.names is None:
            raise InputError(
                f"{name} is an array of shape {data.shape}, which does not say what its columns are; {REMEDY}."
            )
        return _of_arrays({field: data[field] for field in data.dtype.names}, name)
    if isinstance(data, Mapping):
        return _of_arrays(data, name)
    if is_frame(data):
        return _of_arrays(frame_arrays(data, name), name)
    raise InputError(f"{name} is {_named(data)}, which is no log; {REMEDY}.")


def _named(data: object) -> str:
    kind = type(data).__name__
    return f"{'an' if kind[:1].lower() in 'aeiou' else 'a'} {kind}"


def _recorded(recording: Measurements, name: str) -> MemoryLog:
    """Return a recording as a log; what was filled in is no measurement, and is left out again."""
    arrays: dict[str, Any] = dict(recording.arrays())
    if recording.joint_names is not None:
        arrays[LABELS[-1]] = list(recording.joint_names)
    return _of_arrays(
        arrays, name, LogColumns(rate=recording.stated_rate, missing="fill"), {"t": recording.clock_origin}
    )


def _of_arrays(
    data: Mapping[Any, Any], name: str, stated: LogColumns | None = None, origins: Mapping[str, int] | None = None
) -> MemoryLog:
    arrays: Columns = {}
    offsets: dict[str, int] = {}
    origins = dict(origins or {})
    texts: dict[str, NDArray[Any]] = {}
    for key, values in data.items():
        if not isinstance(key, str):
            raise InputError(f"{name} has a column named {shown(key)}; name columns by strings, such as t and q1.")
        array = _array(values, key, name)
        is_column = array.ndim == 1 and array.size > 0
        offset = offset_of(array[0]) if is_column and array.dtype.kind in "iu" else 0
        origin = origin_of_times(array) if is_column else 0
        numbers = _numbers(array, offset, origin)
        if numbers is None and array.dtype.kind in "OUS":
            origin = origin_of_dates(array.tolist()) if is_column else 0
            numbers = seconds_of_texts(array, origin)
        offsets |= {key: offset} if offset else {}
        origins |= {key: origin} if origin else {}
        if numbers is None and array.ndim == 1:
            texts[key] = array
        elif numbers is None or array.ndim > 2:
            raise InputError(
                f"{name}: {key!r} has shape {array.shape} and type {array.dtype}; expected numbers, with one row for "
                "each sample."
            )
        elif array.ndim > 0:  # a single number, such as a rate, is no column
            arrays[key] = numbers
    _check_lengths(arrays, name)
    if not arrays:
        raise InputError(f"{name} holds no columns of numbers; {REMEDY}.")
    rows = len(next(iter(arrays.values())))
    if rows == 0:
        raise InputError(f"{name} holds no rows; expected one row for each sample.")
    labels: tuple[str, ...] = ()
    for key in LABELS:
        if key in texts and len(texts[key]) != rows:
            labels = tuple(map(str, texts.pop(key)))
    once = {key: {str(text) for text in values if text is not None} for key, values in texts.items()}
    return MemoryLog(flattened(arrays), name, labels, stated, once, offsets, origins)


def _check_lengths(arrays: Columns, name: str) -> None:
    lengths = {key: len(array) for key, array in arrays.items()}
    if len(set(lengths.values())) <= 1:
        return
    shapes = {key: array.shape for key, array in arrays.items()}
    rows = max(lengths.values())
    longest = next(key for key, length in lengths.items() if length == rows)
    other, shape = next((key, shape) for key, shape in shapes.items() if shape[0] != rows)
    turned = len(shape) == 2 and shape[1] == rows
    remedy = "transpose it" if turned else "cut them to the same samples"
    raise InputError(
        f"{name}: {other!r} has shape {shape} where {longest!r} has {rows} rows; expected one row for each sample and "
        f"one column for each joint: {remedy}."
    )


def _array(values: object, key: str, name: str) -> NDArray[Any]:
    try:
        if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "fiub":
            return np.where(np.ma.getmaskarray(values), np.nan, np.asarray(values, dtype=np.float64))
        return np.asarray(values)
    except (TypeError, ValueError):
        raise InputError(
            f"{name}: {key!r} has rows of different lengths; expected one row for each sample and one column for each "
            "joint."
        ) from None


def _numbers(array: NDArray[Any], offset: int, origin: int) -> NDArray[np.float64] | None:
    """Return an array as numbers, dates and durations in s; None where it holds something else."""
    if array.dtype.kind in "mM":
        return seconds_of_times(array, origin)
    if offset:
        return less_offset(array, offset)
    if array.dtype.kind == "O":
        try:  # numbers with None among them
            return array.astype(np.float64)
        except (TypeError, ValueError):
            return None
    return array.astype(np.float64, copy=False) if array.dtype.kind in "fiub" else None
