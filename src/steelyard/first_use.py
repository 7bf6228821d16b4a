"""Packages that import a file when a name of it is first used."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

__all__ = ["import_at_first_use"]


class _Package(ModuleType):
    """A package whose names are imported when they are first used."""

    _homes: dict[str, str]

    def __getattr__(self, name: str) -> Any:
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
        return sorted({*self.__dict__, *self._homes})


def import_at_first_use(package: str, listed: str) -> list[str]:
    """Let a package hand out the names that a file lists, and import each from its home when it is first used.

    Importing one file of a package then loads this file and what it needs, not all files of the package.

    Parameters
    ----------
    package : str
        The ``__name__`` of the package.
    listed : str
        The file that lists the names for type checkers, one a line as ``from .home import name as name``: the
        ``__init__.py`` itself, where they stand under ``if TYPE_CHECKING:``, or a stub.

    Returns
    -------
    list of str
        The names, sorted: the package's ``__all__``.

    Examples
    --------
    >>> from steelyard.feasibility import check  # the function, although its file has the same name
    >>> check.__module__
    'steelyard.feasibility.check'
    """
    text = Path(listed).read_text(encoding="utf-8")
    found = re.findall(r"^ *from (\.[\w.]+) import (\w+) as \2$", text, re.MULTILINE)
    module = sys.modules[package]
    module.__dict__["_homes"] = {name: home for home, name in found}
    module.__class__ = _Package
    return sorted(name for _, name in found)
