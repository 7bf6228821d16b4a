"""Checks of what users give, in files and as arguments: numbers within limits, one for each joint, known names."""

from __future__ import annotations

import difflib
import math
import numbers
import re
from collections.abc import Iterable
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

from .reading import shown

__all__ = [
    "LARGEST",
    "LONGEST_NAME",
    "all_listed",
    "by_name",
    "closest",
    "is_name",
    "is_number",
    "is_real",
    "listed",
    "per_joint",
    "positive",
    "read_number",
    "read_whole",
    "real_array",
    "suggestion",
]

Array = NDArray[np.float64]

LARGEST = 1e15
"""In SI units; no robot has anything larger, and squares of larger numbers lose digits that others need."""
LONGEST_NAME = 200
"""Characters, so that a message with two names stays a sentence."""


def is_name(value: object) -> bool:
    """Tell whether a value is a text that fits into a message, as the name of every robot, link and joint does."""
    return isinstance(value, str) and 0 < len(value) <= LONGEST_NAME and "\n" not in value


def is_real(value: object) -> TypeGuard[float]:
    """Tell whether a value is a real number, of Python or NumPy; a truth value is none."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def is_number(value: object) -> TypeGuard[float]:
    """Tell whether a value is a real number of a size that things have."""
    return is_real(value) and abs(value) <= LARGEST


def read_number(
    value: object,
    what: str,
    expected: str = "a number",
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    infinite: bool = False,
) -> float:
    """Return a number within limits.

    Parameters
    ----------
    value : object
        What was given.
    what : str
        What it is; begins the message.
    expected : str
        What it must be, in the message.
    above, least, below : float, optional
        The number must be larger than the first, at least the second, and smaller than the third.
    infinite : bool
        Whether it may be infinite.

    Raises
    ------
    InputError
        If it is not a number, or not such a one.

    Examples
    --------
    >>> read_number(3, "gain")
    3.0
    >>> read_number(-1, "mass of link1", "a positive number of kg", above=0)
    Traceback (most recent call last):
        ...
    steelyard.errors.InputError: mass of link1 must be a positive number of kg, got -1.
    """
    fits = is_number(value) or (infinite and is_real(value) and value in (math.inf, -math.inf))
    number = float(value) if fits else math.nan  # type: ignore[arg-type]
    within = (
        (above is None or number > above) and (least is None or number >= least) and (below is None or number < below)
    )
    if not (fits and within):
        raise InputError(f"{what} must be {expected}, got {shown(value)}.")
    return number + 0.0


def read_whole(value: object, what: str, least: int = 0) -> int:
    """Return a whole number, of Python or NumPy, also one that is written as 3.0.

    Parameters
    ----------
    value : object
        What was given.
    what : str
        What it is; begins the message.
    least : int
        The smallest number that is allowed.

    Raises
    ------
    InputError
        If it is not a whole number, or a smaller one.

    Examples
    --------
    >>> read_whole(3.0, "starts", 1)
    3
    >>> read_whole(-1, "seed")
    Traceback (most recent call last):
        ...
    steelyard.errors.InputError: seed must be a whole number of at least 0, got -1.
    """
    if not (is_number(value) and float(value).is_integer() and value >= least):
        raise InputError(f"{what} must be a whole number of at least {least}, got {shown(value)}.")
    return int(value)


def real_array(values: Any, what: str, expected: str = "real numbers") -> Array:
    """Return numbers as an array of floats, of whatever shape.

    Parameters
    ----------
    values : array_like
    what : str
        What they are; begins the message.
    expected : str
        What they must be, in the message.

    Raises
    ------
    InputError
        If they are texts, times, or rows of different lengths; or complex or masked, since imaginary parts and masks
        would be lost.

    Examples
    --------
    >>> real_array([[1, 2]], "q").tolist()
    [[1.0, 2.0]]
    >>> real_array([1.0 + 1e-20j], "q")
    Traceback (most recent call last):
        ...
    steelyard.errors.InputError: q must be real numbers, got [(1+1e-20j)].
    """
    try:
        given = np.asarray(values)
        if given.dtype.kind in "biufO" and not np.ma.is_masked(values):
            return given.astype(np.float64, copy=False)
    except InputError:  # which is a ValueError, too
        raise
    except (TypeError, ValueError):
        pass
    found = shown(values)
    if isinstance(values, np.ndarray):
        found = "an array with masked numbers" if np.ma.is_masked(values) else f"an array of {values.dtype}"
    raise InputError(f"{what} must be {expected}, got {found}.")


def closest(name: object, known: Iterable[str]) -> str | None:
    """Return the known name that is closest to another one, whatever its capitals; None where none is close."""
    if not isinstance(name, str):
        return None
    by_lower = {candidate.lower(): candidate for candidate in reversed(list(known))}
    # "m3" and "m2" have a similarity of 0.5, and one is worth suggesting for the other.
    found = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.5)
    return by_lower[found[0]] if found else None


def suggestion(name: object, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: the closest known name, or the first few known ones.

    Examples
    --------
    >>> suggestion("elbw", ["shoulder", "elbow"])
    'did you mean "elbow"?'
    >>> suggestion("x", ["shoulder", "elbow"])
    'known are "shoulder", "elbow".'
    """
    candidates = [str(candidate) for candidate in known]
    close = closest(name, candidates)
    if close is not None:
        return f'did you mean "{close}"?'
    if not candidates:
        return "there are none."
    quoted = [f'"{candidate}"' for candidate in candidates]
    return f"known are {listed(quoted, 8)}."


def all_listed(names: Iterable[object]) -> str:
    """Return all names, the last one behind "and".

    Examples
    --------
    >>> all_listed([10, 20, 5]), all_listed(["elbow"])
    ('10, 20 and 5', 'elbow')
    """
    *first, last = map(str, names)
    return f"{', '.join(first)} and {last}" if first else last


def by_name(name: str) -> tuple[tuple[int, int, str], ...]:
    """Return a key by which names are sorted part by part, their numbers by size.

    Examples
    --------
    >>> sorted(["A-10", "B-1", "A-9"], key=by_name)
    ['A-9', 'A-10', 'B-1']
    """
    pieces = re.split(r"(\d+)", name)  # texts, and numbers between them
    return tuple((0, int(piece), piece) if number % 2 else (1, 0, piece) for number, piece in enumerate(pieces))


def listed(names: Iterable[object], most: int = 20) -> str:
    """Return names with commas between them, of which a message shows the first ones and counts the others.

    Examples
    --------
    >>> listed(["shoulder", "elbow"]), listed(range(100), 3), listed([])
    ('shoulder, elbow', '0, 1, 2 and 97 more', 'none')
    """
    words = [str(name) for name in names]
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return f"{', '.join(words[:most])}{more}" if words else "none"


def per_joint(
    value: Any, count: int, name: str, *, zero: bool = True, finite: bool = False, signed: bool = False
) -> Array:
    """Return one number for each joint.

    Parameters
    ----------
    value : array_like
        One number for all joints, or (N,). Negative numbers are refused, unless they are `signed`.
    count : int
        Number N of joints.
    name : str
        What the numbers are called in messages.
    zero : bool
        Whether 0 is allowed.
    finite : bool
        Whether infinite numbers are refused.
    signed : bool
        Whether numbers of either sign are allowed.

    Returns
    -------
    ndarray
        (N,).

    Raises
    ------
    InputError
        If the shape is another one, or a number is out of range.

    Examples
    --------
    >>> per_joint(2.0, 3, "kp").tolist()
    [2.0, 2.0, 2.0]
    """
    array = real_array(value, name, "a number, or one for each joint")
    if array.shape not in ((), (count,)):
        raise InputError(f"{name} must be a number, or one for each of {count} joints, got shape {array.shape}.")
    in_range = np.isfinite(array) if finite else ~np.isnan(array)
    if signed and not in_range.all():
        raise InputError(f"{name} must be {'finite' if finite else 'numbers'}, got {array.tolist()}.")
    if not (signed or (in_range & (array >= 0.0 if zero else array > 0.0)).all()):
        required = f"{'finite and ' if finite else ''}{'at least' if zero else 'above'} 0"
        raise InputError(f"{name} must be {required}, got {array.tolist()}.")
    return np.array(np.broadcast_to(array, (count,)))


def positive(value: Any, name: str, unit: str, *, zero: bool = False) -> float:
    """Return a finite number above 0, or at least 0 with `zero`.

    Parameters
    ----------
    value : float
    name, unit : str
        What the number is called in messages, and its unit; ``"1"`` where it has none.
    zero : bool
        Whether 0 is allowed.

    Raises
    ------
    InputError
        If it is something else.

    Examples
    --------
    >>> positive(0.001, "sample_time", "s")
    0.001
    """
    of_unit = "" if unit == "1" else f", in {unit}"
    if is_real(value) and value == math.inf:
        raise InputError(f"{name} must be finite{of_unit}, got {value!r}.")
    required = "a number of at least 0" if zero else "a positive number"
    return read_number(value, name, required + of_unit, least=0 if zero else None, above=None if zero else 0)
