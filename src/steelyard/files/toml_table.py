"""A table of a TOML file, read key by key: every message names the file, the table and the key."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from steelyard.errors import InputError

from .reading import shown
from .suggestion import suggestion

__all__ = ["TomlTable"]

LARGEST = 1e15  # in SI units


class TomlTable(Mapping[str, Any]):
    """A table of which every key is known.

    Parameters
    ----------
    content : object
        What stands in the file; it must be a table.
    where : str
        The file and the table, such as ``robot.toml, [limits]``; it begins every message.
    keys : sequence of str
        Those that may be given.
    unknown : str
        What the message says of any other key, before it suggests one.

    Raises
    ------
    InputError
        If it is no table, or holds an unknown key.

    Examples
    --------
    >>> table = TomlTable({"urdf": "arm.urdf", "gravity": [0, 0, -9.81]}, "robot.toml", ("urdf", "gravity", "tip"))
    >>> table.text("urdf"), table.text("tip"), table.numbers("gravity", 3)
    ('arm.urdf', None, [0.0, 0.0, -9.81])
    >>> TomlTable({"grvity": 0}, "robot.toml", ("urdf", "gravity"))
    Traceback (most recent call last):
        ...
    steelyard.errors.InputError: robot.toml: 'grvity' is not known here; did you mean "gravity"?
    """

    def __init__(self, content: object, where: str, keys: Sequence[str], unknown: str = "is not known here") -> None:
        if not isinstance(content, Mapping):
            raise InputError(f"{where}: a table is expected, got {shown(content)}")
        for key in content:
            if key not in keys:
                raise InputError(f"{where}: {shown(key)} {unknown}; {suggestion(str(key), keys)}")
        self.content, self.where = content, where

    def __getitem__(self, key: str) -> Any:
        return self.content[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.content)

    def __len__(self) -> int:
        return len(self.content)

    def refuse(self, key: str, expected: str) -> InputError:
        """Return the error that says what the value of a key must be, and what it is."""
        return InputError(f"{self.where}: {key} must be {expected}, got {shown(self.get(key))}")

    def text(self, key: str, expected: str = "a string") -> str | None:
        """Return a text that is not empty, or None where the key is absent."""
        value = self.get(key)
        if value is not None and (not isinstance(value, str) or not value):
            raise self.refuse(key, expected)
        return value

    def texts(self, key: str, expected: str = "a list of strings") -> list[str]:
        """Return a list of texts that are not empty; an empty list where the key is absent."""
        value = self.get(key, [])
        if not isinstance(value, list) or not all(isinstance(one, str) and one for one in value):
            raise self.refuse(key, expected)
        return value

    def flag(self, key: str, default: bool = False) -> bool:
        """Return a truth value."""
        value = self.get(key, default)
        if not isinstance(value, bool):
            raise self.refuse(key, "true or false")
        return value

    def number(self, key: str) -> float:
        """Return a finite number."""
        if not is_number(self[key]):
            raise self.refuse(key, "a number, finite")
        return float(self[key])

    def numbers(self, key: str, count: int, *, infinite: bool = False, expected: str = "") -> list[float]:
        """Return a list of so many numbers, finite unless `infinite`."""
        value = self[key]
        valid = isinstance(value, list) and len(value) == count
        if not valid or not all(is_number(one) or (infinite and one in (math.inf, -math.inf)) for one in value):
            raise self.refuse(key, expected or f"{count} numbers{'' if infinite else ', finite'}")
        return [float(one) for one in value]

    def table(self, key: str, keys: Sequence[str], unknown: str = "is not known here") -> TomlTable:
        """Return the table that a key holds; an empty one where it is absent."""
        return TomlTable(self.get(key, {}), f"{self.where}, [{key}]", keys, unknown)

    def tables(self, key: str, name: str = "") -> list[tuple[str, Mapping[str, Any]]]:
        """Return one table or a list of them as written, each with its place in the file."""
        value, name = self.get(key, []), name or key
        if isinstance(value, Mapping):
            return [(f"{self.where}, [{name}]", value)]
        if not isinstance(value, list) or not all(isinstance(one, Mapping) for one in value):
            raise InputError(f"{self.where}: {name} must be written as [[{name}]], one table each, got {shown(value)}")
        return [(f"{self.where}, [[{name}]] number {number}", one) for number, one in enumerate(value, start=1)]


def is_number(value: object) -> bool:
    """Tell whether a value is a number of a size that things have; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
