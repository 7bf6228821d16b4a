"""Checks of what users and their objects give to a simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["checked_torque", "per_joint", "positive"]

Array = NDArray[np.float64]


def checked_torque(value: Any, shape: tuple[int, ...]) -> Array:
    """Return torques as an array of a shape; numbers that are not finite pass, and end the run."""
    try:
        torque = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"torque must return an array of shape {shape}, got {type(value).__name__}.") from None
    if torque.shape != shape:
        raise InputError(f"torque must return an array of shape {shape}, got {torque.shape}.")
    return torque


def per_joint(value: Any, count: int, name: str, *, zero: bool = True) -> Array:
    """Return a number, or one for each joint, as (N,): not negative, positive where `zero` is False."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, or one for each joint, got {value!r}.") from None
    if array.shape not in ((), (count,)):
        raise InputError(f"{name} must be a number, or one for each of {count} joints, got shape {array.shape}.")
    if np.isnan(array).any() or (array < 0.0).any() or (not zero and (array == 0.0).any()):
        raise InputError(f"{name} must be {'at least' if zero else 'above'} 0, got {array.tolist()}.")
    return np.array(np.broadcast_to(array, (count,)))


def positive(value: Any, name: str, unit: str) -> float:
    """Return a positive, finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)) or not value > 0:
        raise InputError(f"{name} must be a positive number, {unit}, got {value!r}.")
    if not np.isfinite(value):
        raise InputError(f"{name} must be finite, {unit}, got {value!r}.")
    return float(value)
