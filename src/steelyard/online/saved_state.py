"""The state of an estimator in a file, to the last bit: a text in JSON of what it is, and the numbers beside it."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Mapping
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from steelyard.files import parse_json, read_bytes, replaced_file, require_format
from steelyard.files.arrays import read_array

__all__ = ["REMEDY", "Stateful", "alike", "read_state", "state_of", "take_over", "write_state"]

FORMAT = "steelyard-online-estimator-1"
REMEDY = "give a file that OnlineEstimator.save wrote, or let the estimator learn anew"
LARGEST = 4_000_000_000
"""Bytes; an arm of seven joints with drives has some 7 MB, and 0.7 MB more for each change that was noticed."""
KINDS = {"f": np.float64, "i": np.int64, "b": np.bool_}


class Stateful:
    """What has a state: the values of some of its attributes.

    They are numbers, truth values, arrays, objects that have a state themselves, and lists, tuples and mappings of
    these.
    """

    _STATE: ClassVar[tuple[str, ...]] = ()
    """Names of the attributes. The others follow from what it was made with."""

    def state(self) -> dict[str, Any]:
        """Return the state, of which nothing is copied."""
        return state_of(self, self._STATE)

    def restore(self, state: Mapping[str, Any]) -> Self:
        """Take a state over; this object was made as the other one was, and nothing happened to it since.

        Raises
        ------
        ValueError, KeyError, TypeError
            If it is no state of such an object.
        """
        take_over(self, self._STATE, state)
        return self


def state_of(owner: object, names: Iterable[str]) -> dict[str, Any]:
    """Return the values of attributes by their names, those that have a state by this."""
    values = {name.lstrip("_"): getattr(owner, name) for name in names}
    return {name: value.state() if isinstance(value, Stateful) else value for name, value in values.items()}


def take_over(owner: object, names: Iterable[str], state: Mapping[str, Any]) -> None:
    """Give attributes the values that `state_of` returned."""
    for name in names:
        setattr(owner, name, alike(getattr(owner, name), state[name.lstrip("_")], name.lstrip("_")))


def alike(own: Any, given: Any, name: str) -> Any:
    """Return what was given as the kind of thing that is there; an axis of no length may have any.

    Raises
    ------
    ValueError
        If it is another kind of thing.
    """
    if isinstance(own, Stateful):
        return own.restore(given)
    if isinstance(own, np.ndarray):
        fits = isinstance(given, np.ndarray) and given.dtype == own.dtype and given.ndim == own.ndim
        if not fits or not all(n in (0, m) for n, m in zip(own.shape, given.shape, strict=True)):
            raise ValueError(f"{name} must be an array of the shape {own.shape}")
        return np.array(given, order="C" if own.flags.c_contiguous else "F")
    if isinstance(own, dict):
        return {key: alike(value, given[key], name) for key, value in own.items()}
    if isinstance(own, tuple | list) and own:
        return type(own)(alike(*pair, name) for pair in zip(own, given, strict=True))
    # What is empty or absent at first may be anything of the kind.
    if own is not None and type(own) is not type(given):
        raise ValueError(f"{name} must be of the type {type(own).__name__}")
    return given


def write_state(state: Mapping[str, Any], path: str | Path) -> None:
    """Write a state; the file appears whole or not at all."""
    numbers: list[NDArray[np.float64]] = [np.zeros(0)]

    def described(value: Any) -> Any:
        if isinstance(value, float | np.ndarray | np.generic):
            array = np.asarray(value)
            numbers.append(array.astype(np.float64).ravel())
            return {"kind": array.dtype.kind, "shape": list(array.shape)}
        if isinstance(value, Mapping):
            return {key: described(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [described(item) for item in value]
        return value

    text = json.dumps({"format": FORMAT, "state": described(state)}, allow_nan=False)
    with replaced_file(path) as file:
        np.savez(file, description=np.frombuffer(text.encode(), np.uint8), numbers=np.concatenate(numbers))


def read_state(path: str | Path) -> dict[str, Any]:
    """Read what `write_state` wrote.

    Raises
    ------
    InputError
        If the file is missing or too large, or is of another format.
    ValueError, KeyError, TypeError, zipfile.BadZipFile, ...
        Whatever there is to meet in damaged archives.
    """
    content = read_bytes(path, largest=LARGEST, remedy=REMEDY)
    with zipfile.ZipFile(BytesIO(content)) as archive:
        found = []
        for name in ("description.npy", "numbers.npy"):
            with archive.open(name) as stream:
                found.append(read_array(stream, len(content)))
    text, numbers = found
    document = parse_json(text.tobytes().decode(), path, remedy=REMEDY)
    require_format(document["format"], FORMAT, path, "let the estimator learn anew")
    taken = 0

    def restored(value: Any) -> Any:
        nonlocal taken
        if isinstance(value, dict) and set(value) == {"kind", "shape"}:
            begin, taken = taken, taken + prod(value["shape"])
            array: NDArray[Any] = numbers[begin:taken].astype(KINDS[value["kind"]]).reshape(value["shape"])
            return array if value["shape"] else array.item()
        if isinstance(value, dict):
            return {key: restored(item) for key, item in value.items()}
        return [restored(item) for item in value] if isinstance(value, list) else value

    state = restored(document["state"])
    if taken != len(numbers):
        raise ValueError(f"it holds {len(numbers)} numbers and tells of {taken}")
    return dict(state)
