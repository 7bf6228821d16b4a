"""The exceptions that Steelyard raises on purpose.

Every message is one sentence that names the file, line or joint, what was found, what was expected and the remedy.
"""

__all__ = ["InputError", "MissingExtraError", "SolverError", "SteelyardError"]


class SteelyardError(Exception):
    """Base class of all the errors that Steelyard raises on purpose."""


class InputError(SteelyardError, ValueError):
    """Something that the user gave (file, value, option) cannot be used; the message says what and how to mend it."""


class MissingExtraError(SteelyardError, ImportError):
    """An optional dependency is absent; the message names the extra that brings it."""


class SolverError(SteelyardError, RuntimeError):
    """A numerical solver ended without a usable answer; the message says with which status."""
