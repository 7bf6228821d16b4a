"""Checks of the numbers and torques that users and their objects give to simulations and controllers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["checked_torque", "per_joint", "positive"]

Array = NDArray[np.float64]


def checked_torque(value: Any, shape: tuple[int, ...]) -> Array:
    """Return torques as an array of a given shape.

    Values that are not finite are let through: they do not stop the program, but end the run that they belong to.

    Raises
    ------
    InputError
        If the value is no array of numbers, or its shape is another one.
    """
    try:
        torque = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"torque must return an array of shape {shape}, got {type(value).__name__}.") from None
    if torque.shape != shape:
        raise InputError(f"torque must return an array of shape {shape}, got {torque.shape}.")
    return torque


def per_joint(value: Any, count: int, name: str, *, zero: bool = True, finite: bool = False) -> Array:
    """Return one number for each joint.

    Parameters
    ----------
    value : array_like
        One number for all joints, or (N,). Negative numbers are refused.
    count : int
        Number N of joints.
    name : str
        What the numbers are called in messages.
    zero : bool
        Whether 0 is allowed.
    finite : bool
        Whether infinite numbers are refused.

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
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, or one for each joint, got {value!r}.") from None
    if array.shape not in ((), (count,)):
        raise InputError(f"{name} must be a number, or one for each of {count} joints, got shape {array.shape}.")
    in_range = np.isfinite(array) if finite else ~np.isnan(array)
    if not (in_range & (array >= 0.0 if zero else array > 0.0)).all():
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
    required = "a number of at least 0" if zero else "a positive number"
    of_unit = "" if unit == "1" else f", in {unit}"
    number = isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool)
    if not number or not (value > 0.0 or (zero and value == 0.0)):
        raise InputError(f"{name} must be {required}{of_unit}, got {value!r}.")
    if not np.isfinite(value):
        raise InputError(f"{name} must be finite{of_unit}, got {value!r}.")
    return float(value)
