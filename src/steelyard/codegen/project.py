"""Source projects: functions written out in a language, with documentation, self-test and build files."""

from __future__ import annotations

import math
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError, faults_told
from steelyard.extensions import Extensions
from steelyard.files import replaced_folder, shown, write_bytes
from steelyard.files.arguments import closest
from steelyard.graph import Function
from steelyard.graph.expression import reachable
from steelyard.once import cached_property

from .reference import Reference, reference_of
from .text import MARKER

__all__ = ["LANGUAGES", "Constant", "Project", "SourceWriter", "files", "generate", "languages", "write_files"]

_ALIASES = {"c99": "c", "c++": "cpp", "numpy": "python", "matlab": "octave"}
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True)
class Constant:
    """A number that the generated source gives a name.

    Attributes
    ----------
    name : str
        An identifier in lower case, such as ``"joint_count"``; languages write it in their own way.
    value : int or float
        Finite; an integer is of at most 31 bits.
    description : str
        What it is, any text.
    """

    name: str
    value: int | float
    description: str = ""

    def __post_init__(self) -> None:
        if not _IDENTIFIER.fullmatch(self.name):
            raise InputError(f"a constant's name is of letters, digits and _, got {self.name!r}.")
        if isinstance(self.value, int):
            if abs(self.value) >= 2**31:
                raise InputError(f"the constant {self.name!r} must be an integer of at most 31 bits, got {self.value}.")
        elif not math.isfinite(self.value):
            raise InputError(f"the constant {self.name!r} must be finite, got {self.value}.")


@dataclass(frozen=True, eq=False)
class Project:
    """Functions that are written out together.

    Attributes
    ----------
    name : str
        Any text, such as a robot's name; it becomes a prefix, a namespace or a package name.
    functions : tuple of Function
        At least one, with different names.
    description : str
        What the functions belong to, any text.
    constants : tuple of Constant
        Sizes and other numbers that a user of the source needs.
    reference : mapping
        For each argument's name a few rows (S, width): inputs of the embedded self-test. The expected outputs come
        from :meth:`steelyard.graph.Function.evaluate`.
    version : str
        Of the program that generates, for the first line of each file.

    Examples
    --------
    >>> from steelyard.graph import Argument, Graph, Output, sin
    >>> x = Graph().inputs("x", 1)
    >>> f = Function("f", (Argument("x", 1),), (Output("y", (), (sin(x[0]),)),))
    >>> project = Project("pendulum", (f,), "", (), {"x": np.array([[0.5]])}, "1.0")
    >>> sorted(files(project, "c"))
    ['CMakeLists.txt', 'README.md', 'pendulum.c', 'pendulum.h', 'pendulum_test.c']
    """

    name: str
    functions: tuple[Function, ...]
    description: str
    constants: tuple[Constant, ...]
    reference: Mapping[str, NDArray[np.float64]]
    version: str

    def __post_init__(self) -> None:
        if not self.functions:
            raise InputError(f"the project {self.name!r} has no functions; give at least one.")
        for kind, names in (
            ("function", [function.name for function in self.functions]),
            ("constant", [constant.name for constant in self.constants]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise InputError(f"the project {self.name!r} has two {kind}s named {twice[0]!r}; rename one.")
        for function in self.functions:
            for output in function.outputs:
                if not output.size:
                    raise InputError(f"the output {output.name!r} of {function.name!r} has no elements; leave it out.")
            for node in reachable(function.nodes):
                if node.operation == "constant" and not math.isfinite(float(node.value)):
                    raise InputError(
                        f"the function {function.name!r} holds the constant {node.value}, which has no literal in most "
                        "languages; look for an overflow in its numbers."
                    )

    @cached_property
    def references(self) -> dict[str, Reference]:
        """Inputs, expected outputs and tolerances of the self-test, by function."""
        return {function.name: reference_of(function, self.reference) for function in self.functions}


class SourceWriter(ABC):
    """Writes the source of one project in one language; its `write` is what a language is."""

    def __init__(self, project: Project) -> None:
        self.project = project

    @classmethod
    def write(cls, project: Project) -> dict[str, str]:
        """Return the files of a project by relative path."""
        return cls(project).files()

    @abstractmethod
    def files(self) -> dict[str, str]:
        """Return the files of the project by relative path."""


Writer = Callable[[Project], dict[str, str]]
"""What a language is: a function that returns the files of a project as text, by relative path."""


def _checked_writer(name: str, offered: object) -> Writer:
    if not callable(offered):
        raise TypeError(f"expected a function of a steelyard.codegen.Project, got {shown(offered)}")
    return offered


LANGUAGES: Extensions[Writer] = Extensions(
    "languages",
    "language",
    {
        "c": f"{__package__}.c:write",
        "cpp": f"{__package__}.cpp:write",
        "rust": f"{__package__}.rust:write",
        "python": f"{__package__}.python_project:write",
        "octave": f"{__package__}.octave:write",
        "julia": f"{__package__}.julia:write",
        "jax": f"{__package__}.jax:write",
        "casadi": f"{__package__}.casadi:write",
    },
    _checked_writer,
)


def languages() -> tuple[str, ...]:
    """Return the names of the languages, those that other packages add too.

    Examples
    --------
    >>> "c" in languages()
    True
    """
    return LANGUAGES.names()


def files(project: Project, language: str) -> dict[str, str]:
    """Return the files of a project as text, by relative path.

    The same project gives the same text.

    Parameters
    ----------
    project : Project
    language : str
        One of :func:`languages`, or ``"c99"``, ``"c++"``, ``"numpy"``, ``"matlab"``.

    Raises
    ------
    InputError
        Where the language is unknown or its writer fails, or the reference values do not fit the functions.
    """
    name = _ALIASES.get(str(language).lower(), str(language).lower())
    writer = LANGUAGES.get(name)
    if writer is None:
        known = LANGUAGES.names()
        near = closest(name, [*known, *_ALIASES])
        hint = "." if near is None else f'; did you mean "{near}"?'
        raise InputError(f"{language!r} is no language that is generated; there are {', '.join(known)}{hint}")
    if name in LANGUAGES.own:
        return dict(sorted(writer(project).items()))
    with faults_told(f"The language `{name}` cannot write {project.name!r}", "mend its package"):
        return _checked_files(writer(project))


def _checked_files(given: object) -> dict[str, str]:
    """Return what another package's writer gives, if these are files that `generate` can write, and write again."""
    if not isinstance(given, dict) or not given:
        raise TypeError(f"expected a dict of texts by relative path, got {shown(given)}")
    for name, text in given.items():
        path = PurePosixPath(name)
        if path.is_absolute() or not path.parts or any(part == ".." or "\\" in part for part in path.parts):
            raise ValueError(f"{name!r} is no path within the folder")
        if not isinstance(text, str):
            raise TypeError(f"{name} must be text, got {shown(text)}")
        if MARKER not in text.partition("\n")[0]:
            raise ValueError(f"the first line of {name} must hold {MARKER!r}, by which it is known as generated")
    return dict(sorted(given.items()))


def generate(project: Project, language: str, directory: Path) -> tuple[Path, ...]:
    """Write a project to a directory.

    All the files are made first, written beside their places, and then renamed, so that no file is ever half written.

    Parameters
    ----------
    project : Project
    language : str
        See :func:`files`.
    directory : Path
        Made where it is missing.

    Returns
    -------
    tuple of Path
        The files written, in alphabetical order.

    Raises
    ------
    InputError
        Where the language is unknown, where the reference values do not fit the functions, where a file of the same
        name exists that was not generated, or where the directory cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from steelyard.graph import Argument, Graph, Output, cos
    >>> x = Graph().inputs("x", 1)
    >>> f = Function("f", (Argument("x", 1),), (Output("y", (), (cos(x[0]),)),))
    >>> project = Project("pendulum", (f,), "", (), {"x": np.array([[0.5]])}, "1.0")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in generate(project, "c", Path(folder))]
    ['CMakeLists.txt', 'README.md', 'pendulum.c', 'pendulum.h', 'pendulum_test.c']
    """
    return write_files(files(project, language), directory)


def write_files(texts: Mapping[str, str], directory: Path) -> tuple[Path, ...]:
    """Write the files of a generated project: all of them or none, and never over a file that was not generated.

    Parameters
    ----------
    texts : mapping
        By relative path; the first line of each holds the marker.
    directory : Path
        Made where it is missing.

    Returns
    -------
    tuple of Path
        The files written, in the order of `texts`.

    Raises
    ------
    InputError
        As `generate`.

    Examples
    --------
    >>> import tempfile
    >>> from steelyard.codegen.text import marker
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_files({"notes.md": f"<!-- {marker('1.0')} -->"}, Path(folder))]
    ['notes.md']
    """
    contents = {PurePosixPath(name): text.encode() for name, text in texts.items()}
    directory = Path(directory)
    targets = {directory / name: content for name, content in contents.items()}
    for target in targets:
        _check_free(target)
    with replaced_folder(directory) as made:
        for name, content in contents.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            write_bytes(content, made / name)
    return tuple(targets)


def _check_free(target: Path) -> None:
    """Refuse a place where something stands that is not a generated file."""
    if not os.path.lexists(target):
        return
    if target.is_file():
        try:
            with target.open("rb") as file:
                first = file.readline(400)
        except OSError as error:
            raise InputError(
                f"{target} exists and cannot be read: {error.strerror}; choose another directory."
            ) from None
        if MARKER.encode() in first:
            return
    raise InputError(
        f"{target} exists and was not generated by Steelyard, so it is left alone; move it away or choose another "
        "directory."
    )
