"""Gains and other numbers that a user gives to a controller, checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

__all__ = ["joint_gains", "joint_limits", "positive", "symmetric_gains"]

Array = NDArray[np.float64]


def joint_gains(values: ArrayLike, count: int, name: str) -> Array:
    """Return one gain a joint.

    Parameters
    ----------
    values : array_like
        A number for all the joints, or (N,).
    count : int
        N.
    name : str
        For the message.

    Returns
    -------
    ndarray
        (N,).

    Raises
    ------
    InputError
        If the shape is another one, or a gain is negative or not finite.

    Examples
    --------
    >>> joint_gains(2.0, 3, "kp").tolist()
    [2.0, 2.0, 2.0]
    """
    gains = _numbers(values, name)
    if gains.shape not in ((), (count,)):
        raise InputError(f"{name} must be one number, or one for each of {count} joints, got shape {gains.shape}.")
    if not (np.isfinite(gains) & (gains >= 0.0)).all():
        raise InputError(f"{name} must be finite and at least 0, got {gains.tolist()}.")
    return np.array(np.broadcast_to(gains, (count,)))


def joint_limits(values: ArrayLike, count: int, name: str = "torque_limit") -> Array:
    """Return one limit a joint (N,), above 0; infinite where there is none.

    Raises
    ------
    InputError
        If the shape is another one, or a limit is not above 0.

    Examples
    --------
    >>> joint_limits([5.0, np.inf], 2).tolist()
    [5.0, inf]
    """
    limits = _numbers(values, name)
    if limits.shape not in ((), (count,)) or not (limits > 0.0).all():
        raise InputError(f"{name} must be above 0, one number or one for each of {count} joints, got {values!r}.")
    return np.array(np.broadcast_to(limits, (count,)))


def symmetric_gains(values: ArrayLike, count: int, name: str, *, definite: bool = False) -> Array:
    """Return a symmetric matrix of gains in task space.

    Parameters
    ----------
    values : array_like
        A number, (k,) for a diagonal, or a symmetric (k, k) matrix.
    count : int
        k.
    name : str
        For the message.
    definite : bool
        Whether it must be positive definite, instead of semidefinite.

    Returns
    -------
    ndarray
        (k, k).

    Raises
    ------
    InputError
        If the shape is another one, or the matrix is not symmetric, finite and positive.

    Examples
    --------
    >>> symmetric_gains([1.0, 2.0], 2, "stiffness").tolist()
    [[1.0, 0.0], [0.0, 2.0]]
    """
    gains = _numbers(values, name)
    if gains.shape not in ((), (count,), (count, count)):
        raise InputError(
            f"{name} must be one number, {count} numbers or a {count} x {count} matrix, one row for each axis of the "
            f"task, got shape {gains.shape}."
        )
    matrix = gains if gains.ndim == 2 else np.diag(np.broadcast_to(gains, (count,)))
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise InputError(f"{name} must be finite and symmetric, got {gains.tolist()}.")
    values_, scale = np.linalg.eigvalsh(matrix), float(np.abs(matrix).max(initial=0.0))
    if (values_.min() <= 0.0) if definite else (values_.min() < -1e-9 * scale):
        word = "definite" if definite else "semidefinite"
        raise InputError(f"{name} must be positive {word}; its smallest eigenvalue is {values_.min():.3g}.")
    return np.array(matrix)


def positive(value: float, name: str, *, zero: bool = False) -> float:
    """Return a finite number above 0, or at least 0 with `zero`.

    Raises
    ------
    InputError
        If it is something else.

    Examples
    --------
    >>> positive(0.001, "sample_time")
    0.001
    """
    number = _numbers(value, name)
    if number.shape != () or not np.isfinite(number) or number < 0.0 or (number == 0.0 and not zero):
        raise InputError(f"{name} must be a finite number {'at least' if zero else 'above'} 0, got {value!r}.")
    return float(number)


def _numbers(values: ArrayLike, name: str) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers, got {values!r}.") from None
