"""The exceptions that Steelyard raises on purpose.

Every message is one sentence that names the file, line or joint, what was found, what was expected and the remedy.
"""

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["InputError", "MissingExtraError", "SolverError", "SteelyardError", "faults_told"]


class SteelyardError(Exception):
    """Base class of all the errors that Steelyard raises on purpose."""


class InputError(SteelyardError, ValueError):
    """Something that the user gave (file, value, option) cannot be used; the message says what and how to mend it."""


class MissingExtraError(SteelyardError, ImportError):
    """An optional dependency is absent; the message names the extra that brings it."""


class SolverError(SteelyardError, RuntimeError):
    """A numerical solver ended without a usable answer; the message says with which status."""


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
