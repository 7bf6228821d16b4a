"""Extensions: whatever comes in kinds can be added from outside, by installed packages or from Python.

A kind is an `Extensions` table: Steelyard's own by name, and behind them those that a program registers and those that
installed packages offer in the group of entry points ``steelyard.<kind>``. A package is imported when one of its names
is asked for, and not before.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from steelyard.errors import InputError, faults_told
from steelyard.files.arguments import suggestion

__all__ = ["KINDS", "Extensions", "package_of", "register", "unregister"]

T = TypeVar("T")

KINDS = {
    "commands": "steelyard.cli.main:COMMANDS",
    "constraints": "steelyard.feasibility.constraints.toml_section:CONSTRAINTS",
    "description_formats": "steelyard.robot.description:DESCRIPTION_FORMATS",
    "estimators": "steelyard.estimators.estimator:ESTIMATORS",
    "languages": "steelyard.codegen.project:LANGUAGES",
    "log_formats": "steelyard.recording.formats.registry:LOG_FORMATS",
    "solvers": "steelyard.conic.solver:SOLVERS",
    "terms": "steelyard.dynamics.terms:TERMS",
}
"""Where the table of each kind stands; docs/how-to/extend.md says what an extension of each kind is."""

_REGISTERED: dict[tuple[str, str], Any] = {}
_LOADED: dict[tuple[str, str], Any] = {}
"""What packages offer and has been asked for, since looking through all the installed packages takes milliseconds."""

_NAME = re.compile(r"[a-z0-9_.+-]+")


class Extensions(Generic[T]):
    """All extensions of one kind, by name; those of Steelyard itself come first and cannot be replaced.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    noun : str
        What one of them is called in messages, such as ``"solver"``.
    own : mapping
        Those of Steelyard: from name to the thing, or to where it stands as ``"module:attribute"``, which is imported
        when it is asked for.
    check : callable
        ``check(name, offered)`` returns what was offered, made ready for use where that is needed. It raises TypeError
        where that is nothing of this kind, with what was expected and what was found.

    Examples
    --------
    >>> def check(name, offered):
    ...     if not callable(offered):
    ...         raise TypeError(f"expected a function, got {type(offered).__name__}")
    ...     return offered
    >>> roots = Extensions("roots", "root", {"square": "math:sqrt"}, check)
    >>> roots.get("square")(4.0), roots.get("cube"), roots.names()
    (2.0, None, ('square',))
    """

    def __init__(self, kind: str, noun: str, own: Mapping[str, T | str], check: Callable[[str, object], T]) -> None:
        self.kind, self.noun, self.own, self.check = kind, noun, own, check

    @property
    def group(self) -> str:
        """The group of entry points."""
        return f"steelyard.{self.kind}"

    def names(self) -> tuple[str, ...]:
        """Return all the names; nothing is imported."""
        registered = (name for kind, name in _REGISTERED if kind == self.kind)
        return tuple(dict.fromkeys([*self.own, *registered, *self.installed()]))

    def installed(self) -> tuple[str, ...]:
        """Return the names that installed packages offer, sorted."""
        return tuple(sorted({entry.name for entry in entry_points(group=self.group)}))

    def get(self, name: str) -> T | None:
        """Return what has a name; None where nothing has it.

        Raises
        ------
        InputError
            If the package that offers it cannot be imported or offers something else, or several packages offer it.
        """
        if name in self.own:
            found = self.own[name]
            return _entry(self.group, found).load() if isinstance(found, str) else found
        for table in (_REGISTERED, _LOADED):
            if (self.kind, name) in table:
                return table[self.kind, name]  # type: ignore[no-any-return]
        offers = tuple(entry_points(group=self.group, name=name))
        if not offers:
            return None
        if len(offers) > 1:
            raise InputError(
                f"The {self.noun} `{name}` is offered by {self.packages(name)}: uninstall all of them but one."
            )
        whose = f"The {self.noun} `{name}` of {package_of(offers[0])}"
        _LOADED[self.kind, name] = self._loaded(offers[0], whose, "upgrade or uninstall that package")
        return _LOADED[self.kind, name]  # type: ignore[no-any-return]

    def at(self, path: str, where: str, allowed: bool) -> T:
        """Return what stands at an import path that a file names.

        Parameters
        ----------
        path : str
            ``"module:name"``.
        where : str
            The place in the file, for messages.
        allowed : bool
            Whether the user said that code may be run that the file names.

        Raises
        ------
        InputError
            If it is not allowed, cannot be imported, or is nothing of this kind.
        """
        if not allowed:
            raise InputError(
                f"{where}: `{path}` is code, which is not run because a file names it; where you trust the file, allow "
                "it with --allow-extensions (allow_extensions=True in Python)."
            )
        whose = f"{where}: the {self.noun} `{path}`"
        return self._loaded(_entry(path, path), whose, "name one that Python finds, as module:name")

    def register(self, name: str, offered: T) -> None:
        """Add one from Python; see `steelyard.extensions.register`."""
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise InputError(f"The name of a {self.noun} must be one word in lower case, got {name!r}.")
        if name in self.own:
            raise InputError(f"The {self.noun} `{name}` is one of Steelyard's own; choose another name.")
        try:
            _REGISTERED[self.kind, name] = self.check(name, offered)
        except TypeError as error:
            raise InputError(f"The {self.noun} `{name}` cannot be registered: {error}.") from None

    def unregister(self, name: str) -> None:
        """Forget one that was registered; see `steelyard.extensions.unregister`."""
        if (self.kind, name) not in _REGISTERED:
            known = [other for kind, other in _REGISTERED if kind == self.kind]
            raise InputError(f"No {self.noun} is registered as {name!r}; {suggestion(str(name), known)}")
        del _REGISTERED[self.kind, name]

    def packages(self, name: str) -> str:
        """Name the packages that offer one, as "a and b"; empty where none does."""
        return " and ".join(sorted({package_of(entry) for entry in entry_points(group=self.group, name=name)}))

    def _loaded(self, entry: EntryPoint, whose: str, remedy: str) -> T:
        with faults_told(f"{whose} cannot be loaded", remedy):
            return self.check(entry.name, entry.load())


def _entry(name: str, path: str) -> EntryPoint:
    return EntryPoint(name, path, "")


def package_of(entry: EntryPoint) -> str:
    """Name the package that brings an entry point."""
    return entry.dist.name if entry.dist is not None else entry.value


def _table(kind: str) -> Extensions[Any]:
    if kind not in KINDS:
        raise InputError(f"There is no kind of extensions {kind!r}; {suggestion(str(kind), KINDS)}")
    table: Extensions[Any] = _entry(kind, KINDS[kind]).load()
    return table


def register(kind: str, name: str, offered: object) -> None:
    """Add an extension for this program; installed packages name theirs in ``steelyard.<kind>`` instead.

    Parameters
    ----------
    kind : str
        A key of `KINDS`, such as ``"solvers"``.
    name : str
        One word in lower case, by which it will be asked for. An earlier one of that name is replaced.
    offered : object
        What the page *Extend Steelyard* says for its kind.

    Raises
    ------
    InputError
        If it is nothing of this kind, or one of Steelyard's own has that name.

    Examples
    --------
    >>> from steelyard.codegen import languages
    >>> register("languages", "list", lambda project: {"functions.txt": f"Generated by Steelyard: {project.name}"})
    >>> "list" in languages()
    True
    >>> unregister("languages", "list")
    """
    _table(kind).register(name, offered)


def unregister(kind: str, name: str) -> None:
    """Forget an extension that was registered.

    Raises
    ------
    InputError
        If none of that name was registered.
    """
    _table(kind).unregister(name)
