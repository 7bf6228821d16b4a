"""Packages that import a file, or a package inside them, when a name of it is first used."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

__all__ = ["import_at_first_use"]


class _Package(ModuleType):
    """A package whose names and packages are imported when they are first used."""

    _homes: dict[str, str]
    _packages: frozenset[str]

    def __getattr__(self, name: str) -> Any:
        if name in self.__dict__.get("_packages", ()):
            return importlib.import_module(f"{self.__name__}.{name}")
        home = self.__dict__.get("_homes", {}).get(name)
        if home is None:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(home, self.__name__), name)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: object) -> None:
        # Importing a file sets it as an attribute of its package: where a function has the name of its file, as `check`
        # in check.py, the package keeps the function.
        if not (name in self._homes and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *self._homes, *self._packages})


def import_at_first_use(package: str, listed: str) -> list[str]:
    """Let a package hand out the names that a file lists, and import each from its home when it is first used.

    Importing one file of a package then loads this file and what it needs, not all files of the package.

    Parameters
    ----------
    package : str
        The ``__name__`` of the package.
    listed : str
        The file that lists the names for type checkers, one a line as ``from .home import name as name``: the
        ``__init__.py`` itself, where they stand under ``if TYPE_CHECKING:``, or a stub. A line
        ``from . import room as room`` stands for a package inside this one; `room` then needs no import of its own,
        and is not among the names that are returned.

    Returns
    -------
    list of str
        The names, sorted: the package's ``__all__``.

    Examples
    --------
    >>> from steelyard.feasibility import check  # the function, although its file has the same name
    >>> check.__module__
    'steelyard.feasibility.check'
    >>> import steelyard
    >>> steelyard.simulation.Sensors.__module__
    'steelyard.simulation.sensors'
    """
    text = Path(listed).read_text(encoding="utf-8")
    listing = re.findall(r"^ *from (\.[\w.]*) import (\w+) as \2$", text, re.MULTILINE)
    homes = {name: home for home, name in listing if home != "."}
    module = sys.modules[package]
    module.__dict__["_homes"] = homes
    module.__dict__["_packages"] = frozenset(name for home, name in listing if home == ".")
    module.__class__ = _Package
    return sorted(homes)
