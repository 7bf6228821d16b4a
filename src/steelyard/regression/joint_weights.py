"""Weights of the joints in weighted least squares (thesis section 4.4, eq. 4.30 to 4.36)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .factor import Factor

__all__ = ["given_weights", "inverse_deviations"]

Array = NDArray[np.float64]


def inverse_deviations(factors: Sequence[Factor], base: Array) -> Array:
    """Return the inverse standard deviations of the residuals of each joint (thesis eq. 4.32, 4.33).

    Parameters
    ----------
    factors : sequence of Factor
        The rows of each of N joints, unweighted.
    base : (n_b,)
        Base parameters of ordinary least squares, whose residuals they are.

    Returns
    -------
    (N,)
        In 1/(N·m) or 1/N; 1 for a joint without rows.

    Examples
    --------
    >>> rows = np.array([[1.0, 1.0], [1.0, 3.0]])  # the regressor's only column, and the torque: residuals of ±1
    >>> joints = [Factor(j, np.array([0]), scale * rows, 2) for j, scale in enumerate((1.0, 2.0))]
    >>> inverse_deviations(joints, np.array([2.0])).round(4).tolist()
    [0.7071, 0.3536]
    """
    freedom = [max(f.count - len(base), 1) for f in factors]
    values = np.sqrt([f.residual2(base) / n for f, n in zip(factors, freedom, strict=True)])
    # A joint without noise or without rows would get an infinite weight: bound it by the others.
    largest = float(values.max(initial=0.0))
    if largest == 0.0:
        return np.ones(len(values))
    floor = 1e-9 * largest
    return np.where([f.count > 0 for f in factors], 1.0 / np.maximum(values, floor), 1.0)


def given_weights(weights: str | ArrayLike, joints: int) -> Array:
    """Return the weights that a user gave, (joints,).

    Raises
    ------
    InputError
        If they are not one positive number for each joint.
    """
    if isinstance(weights, str):
        raise InputError(f"weights must be None, 'joint' or one number for each joint, got {weights!r}.")
    values = np.asarray(weights, dtype=np.float64)
    if values.shape != (joints,) or not np.all(np.isfinite(values)) or np.any(values <= 0.0):
        raise InputError(f"weights must be {joints} positive numbers, one for each joint, got {weights!r}.")
    return values
