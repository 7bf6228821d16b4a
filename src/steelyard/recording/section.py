"""Sections of robot.toml as frozen dataclasses: unknown keys are refused, defaults stay unwritten."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

from steelyard.files import TomlTable

__all__ = ["Section"]


@dataclass(frozen=True)
class Section:
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
    if isinstance(value, Section):
        return value.described()
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
