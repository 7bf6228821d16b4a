"""Tables of TOML files, read key by key or as dataclasses; every message names the file, the table and the key."""

from __future__ import annotations

import inspect
import math
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self, TypeVar

from steelyard.errors import InputError, faults_told

from .arguments import is_number, suggestion
from .reading import shown

__all__ = ["TomlSection", "TomlTable", "made_from_table"]

T = TypeVar("T")


class TomlTable(Mapping[str, Any]):
    """A table of a TOML file, in which every key must be a known one.

    Parameters
    ----------
    content : object
        What stands in the file; it must be a table.
    where : str
        The file and the table, such as ``robot.toml, [limits]``; it begins every message.
    keys : sequence of str, or None
        The known keys; any key where None.
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

    def __init__(
        self, content: object, where: str, keys: Sequence[str] | None, unknown: str = "is not known here"
    ) -> None:
        if not isinstance(content, Mapping):
            listed = f" with {', '.join(keys)}" if keys else ""
            raise InputError(f"{where} must be a table{listed}, got {shown(content)}")
        for key in content:
            if keys is not None and key not in keys:
                raise InputError(f"{where}: {shown(key)} {unknown}; {suggestion(str(key), keys)}")
        self.content, self.where = content, where

    def __getitem__(self, key: str) -> Any:
        return self.content[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.content)

    def __len__(self) -> int:
        return len(self.content)

    def require(self, *keys: str) -> None:
        """Raise InputError where one of these keys is absent."""
        for key in keys:
            if key not in self.content:
                *first, last = keys
                listed = f"{', '.join(first)} and {last}" if first else last
                raise InputError(f"{self.where} lacks {key!r}; give {listed}")

    def refuse(self, key: str, expected: str) -> InputError:
        """Return the error that says what the value of a key must be, and what it is."""
        return InputError(f"{self.where}: {key} must be {expected}, got {shown(self.get(key))}")

    def text(self, key: str, expected: str = "a string") -> str | None:
        """Return a text that is not empty, or None where the key is absent."""
        value = self.get(key)
        if value is not None and (not isinstance(value, str) or not value):
            raise self.refuse(key, expected)
        return value

    def texts(self, key: str) -> list[str]:
        """Return a list of texts that are not empty; an empty list where the key is absent."""
        value = self.get(key, [])
        if not isinstance(value, list) or not all(isinstance(one, str) and one for one in value):
            raise self.refuse(key, "a list of strings")
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


@dataclass(frozen=True)
class TomlSection:
    """A section of robot.toml whose keys are the fields of a dataclass."""

    section_name: ClassVar[str]

    def __post_init__(self) -> None:
        self._clean(self.section_name)

    @abstractmethod
    def _clean(self, where: str) -> None:
        """Check the values as they were given, and replace them by their final form; `where` is named in messages."""

    @classmethod
    def from_dict(cls, section: Mapping[str, Any], where: str | None = None) -> Self:
        """Build from the section as TOML gives it; `where` names it in messages (for example "robot.toml, [log]").

        Raises
        ------
        InputError
            For an unknown key (with the closest known one) or a value that does not fit.
        """
        where = cls.section_name if where is None else where
        TomlTable(section, where, [field.name for field in fields(cls)])
        result = cls.__new__(cls)
        for field in fields(cls):
            object.__setattr__(result, field.name, section.get(field.name, field.default))
        result._clean(where)
        return result

    def to_dict(self) -> dict[str, Any]:
        """Return the section as TOML or JSON would hold it, without the keys that have their default."""
        values = {field.name: (getattr(self, field.name), field.default) for field in fields(self)}
        return {name: _plain(value) for name, (value, default) in values.items() if value != default}

    def described(self) -> dict[str, Any]:
        """Return what stands for this section where it is the value of a key of another one."""
        return self.to_dict()


def _plain(value: Any) -> Any:
    if value is None:
        return "none"  # TOML has no null
    if isinstance(value, TomlSection):
        return value.described()
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def made_from_table(offered: Callable[..., T], options: Mapping[str, Any], where: str) -> T:
    """Call what a file names with the keys of its table as keyword arguments.

    Parameters
    ----------
    offered : callable
        A class or a function; the names of its arguments are the keys that it takes.
    options : mapping
        The keys and their values.
    where : str
        The place in the file, for messages.

    Raises
    ------
    InputError
        If a key is missing or not known, or a value is refused.

    Examples
    --------
    >>> made_from_table(complex, {"real": 1, "imag": 2}, "numbers.toml, [[complex]]")
    (1+2j)
    >>> def power(base, exponent=2):
    ...     return base**exponent
    >>> made_from_table(power, {"bsae": 3}, "numbers.toml, [[power]]")
    Traceback (most recent call last):
        ...
    steelyard.errors.InputError: numbers.toml, [[power]]: 'bsae' is no key of it; did you mean "base"?
    """
    with faults_told(f"{where} cannot be used", "correct its keys, or mend its package"):
        arguments = inspect.signature(offered).parameters.values()
        named = [one for one in arguments if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]
        takes_all = any(one.kind is one.VAR_KEYWORD for one in arguments)
        table = TomlTable(options, where, None if takes_all else [one.name for one in named], "is no key of it")
        table.require(*(one.name for one in named if one.default is one.empty))
        return offered(**table)
