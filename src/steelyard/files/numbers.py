"""Numbers that users give, in files and as arguments: what counts as one, and the message where it does not."""

from __future__ import annotations

import math
import numbers

from steelyard.errors import InputError

from .reading import shown

__all__ = ["LARGEST", "is_number", "is_real", "read_number"]

LARGEST = 1e15
"""In SI units; no robot has anything larger, and squares of larger numbers lose digits that others need."""


def is_real(value: object) -> bool:
    """Tell whether a value is a real number, of Python or NumPy; a truth value is none."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def is_number(value: object) -> bool:
    """Tell whether a value is a real number of a size that things have."""
    return is_real(value) and abs(value) <= LARGEST  # type: ignore[arg-type]


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
