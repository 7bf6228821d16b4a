"""Results of reductions as bytes, for files and for other processes: JSON and arrays, and nothing that could run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.identification.log_reader import DrawnLog, ReducedLog, ReducedSection
from steelyard.recording import Samples
from steelyard.recording.recognition import ColumnMeaning, Layout
from steelyard.regression import Factor, Information
from steelyard.regression.repeated_motion import ReturningErrors

__all__ = ["is_whole", "packed", "unpacked"]

_MARK = b"steelyard-packed-1\n"
_KINDS: dict[str, type[Any]] = {
    kind.__name__: kind
    for kind in (
        ColumnMeaning,
        DrawnLog,
        Factor,
        Information,
        Layout,
        ReducedLog,
        ReducedSection,
        ReturningErrors,
        Samples,
    )
}
"""What may stand in packed bytes beside numbers, texts, lists, mappings and arrays."""
_PASSED_OVER = {"regressor_model", "bristles", "cutoff_choice"}
"""Fields of samples that are not packed: the model and its friction, which are known where they are unpacked, and a
chart."""
_ARRAYS = {
    kind.str: kind
    for kind in (np.dtype(order + one) for order in "<>" for one in ("?", *"bhilqBHILQ", *"efdg"))
    if kind.kind in "fiub"
}
"""Arrays that may stand there, by the names that NumPy writes; it would take any text for a description to parse."""
_START = len(_MARK) + 32


def is_whole(data: bytes) -> bool:
    """Tell whether bytes are as `packed` made them, to the last one.

    Examples
    --------
    >>> is_whole(packed([1.5])), is_whole(packed([1.5])[:-1]), is_whole(b"")
    (True, False, False)
    """
    return (
        data[: len(_MARK)] == _MARK and hashlib.sha256(memoryview(data)[_START:]).digest() == data[len(_MARK) : _START]
    )


def packed(value: Any) -> bytes:
    """Return a value as bytes: the same ones for the same value, on every machine with the same order of bytes.

    Parameters
    ----------
    value : object
        Numbers, texts, None, lists, tuples, mappings from texts, arrays of numbers, and the results of reductions.

    Raises
    ------
    TypeError
        For anything else.

    Examples
    --------
    >>> unpacked(packed({"count": 3, "rows": np.eye(2), "names": ("a", "b")}))
    {'count': 3, 'rows': array([[1., 0.],
           [0., 1.]]), 'names': ('a', 'b')}
    """
    arrays: list[bytes] = []
    head = json.dumps(_plain(value, arrays), ensure_ascii=False, separators=(",", ":")).encode("utf-8", "surrogatepass")
    content = b"".join([len(head).to_bytes(8, "little"), head, *arrays])
    return b"".join([_MARK, hashlib.sha256(content).digest(), content])


def unpacked(data: bytes) -> Any:
    """Return the value of bytes that `packed` made; its arrays are read-only.

    Raises
    ------
    InputError
        If they are damaged, or something else.
    """
    content = memoryview(data)[_START:]
    if not is_whole(data):
        raise InputError("The bytes are not those of a reduction, or are damaged; reduce the logs anew.")
    size = int.from_bytes(content[:8], "little")
    place = 8 + size

    def taken(kind: str, shape: list[int], order: int | None = None) -> np.ndarray[Any, Any]:
        nonlocal place
        dtype = _ARRAYS[kind]
        if order is not None:
            above = taken(kind, [*shape, order * (order + 1) // 2])
            array = np.zeros((*shape, order * order), dtype)
            if above.size:  # the bytes then hold as many numbers as the triangle has
                array[..., _triangles(order)[0]] = above
            array = array.reshape(*shape, order, order)
        else:
            count = int(np.prod(shape, dtype=np.int64))
            # A copy: a view would hold the bytes of all arrays for as long as one of them is kept.
            array = np.frombuffer(content, dtype, count, place).reshape(shape).copy()
            place += array.nbytes
        array.flags.writeable = False
        return array

    try:
        return _value(json.loads(bytes(content[8 : 8 + size]).decode("utf-8", "surrogatepass")), taken)
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise InputError(f"The bytes of a reduction were made by another version ({error}); reduce anew.") from None


def _plain(value: Any, arrays: list[bytes]) -> Any:
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, int | float | bool):
        return value
    if isinstance(value, list):
        return [_plain(item, arrays) for item in value]
    if isinstance(value, tuple):
        return {"t": [_plain(item, arrays) for item in value]}
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise TypeError("a mapping that is packed must have texts for keys")
        return {"m": [[key, _plain(item, arrays)] for key, item in value.items()]}
    if isinstance(value, np.ndarray) and value.dtype.str in _ARRAYS:
        array = np.ascontiguousarray(value)
        if _is_upper_triangular(array):
            order = array.shape[-1]
            arrays.append(_in_rows(array)[..., _triangles(order)[0]].tobytes())
            return {"a": [array.dtype.str, list(array.shape[:-2]), order]}
        arrays.append(array.tobytes())
        return {"a": [array.dtype.str, list(value.shape)]}
    kind = type(value).__name__
    if _KINDS.get(kind) is type(value):
        named = [(one.name, getattr(value, one.name)) for one in fields(value) if one.name not in _PASSED_OVER]
        return {"k": [kind, {name: _plain(item, arrays) for name, item in named}]}
    raise TypeError(f"{kind} cannot be packed")


@lru_cache(16)
def _triangles(order: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the places of the upper triangle of a matrix, and of what is below it, counted row by row."""
    upper, below = np.triu_indices(order), np.tril_indices(order, -1)
    return upper[0] * order + upper[1], below[0] * order + below[1]


def _in_rows(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return array.reshape(*array.shape[:-2], array.shape[-1] ** 2)


def _is_upper_triangular(array: np.ndarray[Any, Any]) -> bool:
    """Return whether zeros below the diagonal, no negative one among them, need not be packed.

    Triangular factors are nearly all of an Information.
    """
    if array.ndim < 2 or array.shape[-1] != array.shape[-2] or array.shape[-1] < 4:
        return False
    below = _in_rows(array)[..., _triangles(array.shape[-1])[1]]
    return not (below.any() or (below.dtype.kind == "f" and np.signbit(below).any()))


def _value(plain: Any, taken: Callable[[str, list[int]], np.ndarray[Any, Any]]) -> Any:
    if isinstance(plain, list):
        return [_value(item, taken) for item in plain]
    if not isinstance(plain, dict):
        return plain
    ((mark, content),) = plain.items()
    if mark == "t":
        return tuple(_value(item, taken) for item in content)
    if mark == "m":
        return {key: _value(item, taken) for key, item in content}
    if mark == "a":
        return taken(*content)
    kind, values = content
    return _KINDS[kind](**{name: _value(item, taken) for name, item in values.items()})
