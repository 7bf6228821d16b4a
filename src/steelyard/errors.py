"""The exceptions that Steelyard raises on purpose.

Every message is one sentence that names the file, line or joint, what was found, what was expected and the remedy.
"""

import importlib
import importlib.util
import re
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

__all__ = [
    "InputError",
    "MissingExtraError",
    "SolverError",
    "SteelyardError",
    "faults_told",
    "install_command",
    "is_installed",
    "missing_extra",
    "require_package",
]


LONGEST_MESSAGE, LONGEST_WORD = 1000, 200
"""Characters. The longest sentence of ours has 600, with a path of 150; a name in a damaged file may have a million."""


# Control characters, marks that turn the direction of writing, halves of characters, and separators of lines.
_HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")


def printable(text: str) -> str:
    r"""Return a text whose control characters are written out: names in files may hold any, and speak to terminals.

    Examples
    --------
    >>> printable("elbow\x1b[2J"), printable("größe, 20 µm")
    ('elbow\\x1b[2J', 'größe, 20 µm')
    """
    if text.isprintable():
        return text
    return "".join(
        one.encode("unicode_escape").decode("ascii")
        if one not in "\n\t" and unicodedata.category(one) in _HIDDEN
        else one
        for one in text
    )


class SteelyardError(Exception):
    """Base class of all the errors that Steelyard raises on purpose.

    A message stays a sentence, whatever it quotes: control characters are written out, above 1000 characters its long
    words are shortened, and then its middle, because it begins with the place of the fault and ends with the remedy.

    Examples
    --------
    >>> len(str(InputError(f"robot.toml: there is no joint {'9' * 5000!r}; name one of the robot.")))
    253
    """

    longest: ClassVar[int] = LONGEST_MESSAGE
    """Characters of the longest message; one that lists several sentences may have more."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*(_sentence(one, self.longest) if isinstance(one, str) else one for one in arguments))

    @property
    def lines(self) -> tuple[str, ...]:
        """The message, in the lines in which it is printed: one, unless it lists several faults."""
        return (str(self),)


class InputError(SteelyardError, ValueError):
    """Something that the user gave (file, value, option) cannot be used; the message says what and how to mend it."""


class MissingExtraError(SteelyardError, ImportError):
    """An optional dependency is absent; the message names the extra that brings it."""


class SolverError(SteelyardError, RuntimeError):
    """A numerical solver ended without a usable answer; the message says with which status."""


def _sentence(message: str, longest: int) -> str:
    """Return a message with control characters written out, without the middle of what makes it too long."""
    message = printable(message)
    if len(message) > longest:
        long_word = rf"\S{{{LONGEST_WORD + 1},}}"
        message = re.sub(long_word, lambda found: _without_middle(found[0], LONGEST_WORD), message)
    return _without_middle(message, longest)


def _without_middle(text: str, longest: int) -> str:
    end = longest // 4
    return text if len(text) <= longest else f"{text[: longest - end - 1]}…{text[-end:]}"


@contextmanager
def faults_told(what: str, remedy: str, kind: type[SteelyardError] = InputError) -> Iterator[None]:
    """Turn whatever code of another package raises into one sentence: ``what (reason); remedy.``

    Parameters
    ----------
    what, remedy : str
    kind : type
        Of the error that is raised. Errors that this package raises itself, such as InputError, stay as they are.
    """
    try:
        yield
    except SteelyardError:
        raise
    except (Exception, SystemExit) as error:
        reason = " ".join(str(error).split())[:300]
        raise kind(f"{what} ({type(error).__name__}: {reason}); {remedy}.") from error


def missing_extra(what: str, extra: str) -> MissingExtraError:
    """Return the error that says what is not there, and the command that installs it.

    Parameters
    ----------
    what : str
        Such as ``"MJCF is read with the package mujoco, which is not installed"``.
    extra : str

    Examples
    --------
    >>> missing_extra("Meshes need the package trimesh, which is not installed", "meshes")
    MissingExtraError("Meshes need the package trimesh, which is not installed; pip install 'trimesh>=4.6'.")
    """
    return MissingExtraError(f"{what}; {install_command(extra)}.")


def require_package(module: str, need: str, extra: str) -> Any:
    """Import a module of a package that is installed only where it is wanted.

    Parameters
    ----------
    module : str
    need : str
        What the message begins with, before the name of the module: ``"JAX functions need the package"``.
    extra : str
        The extra that brings the package.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise missing_extra(f"{need} {module}, which is not installed", extra) from error


def is_installed(module: str) -> bool:
    """Tell whether a package is installed, without importing it.

    Examples
    --------
    >>> is_installed("numpy"), is_installed("no_such_package")
    (True, False)
    """
    if module in sys.modules:
        return sys.modules[module] is not None
    return importlib.util.find_spec(module) is not None


def install_command(extra: str) -> str:
    """Return the command that installs what an extra brings.

    It names the packages themselves: ``steelyard[extra]`` would be looked for on an index, also by those who work in a
    copy of the source that no index knows.

    Examples
    --------
    >>> install_command("sympy")
    "pip install 'sympy>=1.13'"
    """
    return "pip install " + " ".join(f"'{one}'" for one in _requirements(extra))


def _requirements(extra: str) -> list[str]:
    """Return the packages of an extra, by the source around this file or by what was installed."""
    from importlib import metadata

    project = Path(__file__).resolve().parents[2] / "pyproject.toml"
    if project.is_file():
        import tomllib

        extras = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["optional-dependencies"]
        found = [one.partition(";")[0] for one in extras.get(extra, ())]
    else:
        asked = re.compile(rf"""extra\s*==\s*["']{re.escape(extra)}["']""")
        lines = [one.partition(";") for one in metadata.requires("steelyard") or ()]
        found = [name for name, _, marker in lines if asked.search(marker)]
    within = [re.fullmatch(r"steelyard\[(.*)\]", one.strip()) for one in found]
    own = [one.strip() for one, inner in zip(found, within, strict=True) if inner is None]
    return own + [one for inner in within if inner for name in inner[1].split(",") for one in _requirements(name)]
