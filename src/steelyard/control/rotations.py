"""Rotations: their vectors, and back; of one or many at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["rotation_matrix", "rotation_vector"]

Array = NDArray[np.float64]

_TINY = 1e-150  # keeps a division of zero by zero defined
_FAR = -0.9  # cosine of the angles whose axis the sine does not give well


def rotation_vector(rotation: Array) -> Array:
    """Return axis times angle of rotations, the logarithm; the angle is between 0 and pi.

    It is exact to rounding for small angles and near half a turn alike.

    Parameters
    ----------
    rotation : ndarray
        (..., 3, 3).

    Returns
    -------
    ndarray
        (..., 3), rad. At half a turn one of the two vectors.

    Examples
    --------
    >>> rotation_vector(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])).round(12).tolist()
    [0.0, 0.0, 1.570796326795]
    """
    flat = rotation.reshape((*rotation.shape[:-2], 9))
    sine = 0.5 * (flat[..., (7, 2, 3)] - flat[..., (5, 6, 1)])  # axis times the sine of the angle
    cosine = 0.5 * (flat[..., 0] + flat[..., 4] + flat[..., 8] - 1.0)
    size = np.sqrt(np.sum(sine * sine, axis=-1))
    factor = np.arctan2(size, cosine) / np.maximum(size, _TINY)
    vector = np.where(size > _TINY, factor, 1.0)[..., None] * sine
    far = cosine < _FAR
    if far.any():
        vector = np.where(far[..., None], _near_half_turn(rotation, sine, size, cosine), vector)
    return np.asarray(vector)


def _near_half_turn(rotation: Array, sine: Array, size: Array, cosine: Array) -> Array:
    """Return axis times angle where the sine is small: the axis is the largest column of what is symmetric."""
    symmetric = 0.5 * (rotation + np.swapaxes(rotation, -1, -2)) - cosine[..., None, None] * np.eye(3)
    lengths = np.sum(symmetric * symmetric, axis=-2)
    best = np.argmax(lengths, axis=-1)
    column = np.take_along_axis(symmetric, best[..., None, None], axis=-1)[..., 0]
    axis = column / np.maximum(np.sqrt(np.sum(column * column, axis=-1, keepdims=True)), _TINY)
    turned = np.where(np.sum(axis * sine, axis=-1, keepdims=True) < 0.0, -axis, axis)
    return np.asarray(np.arctan2(size, cosine)[..., None] * turned)


def rotation_matrix(vector: Array) -> Array:
    """Return rotations from axis times angle, the exponential (Rodrigues).

    Parameters
    ----------
    vector : ndarray
        (..., 3), rad.

    Returns
    -------
    ndarray
        (..., 3, 3).

    Examples
    --------
    >>> bool(np.allclose(rotation_vector(rotation_matrix(np.array([0.3, -0.2, 0.1]))), [0.3, -0.2, 0.1]))
    True
    """
    angle = np.sqrt(np.sum(vector * vector, axis=-1))[..., None, None]
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    cross = np.zeros((*x.shape, 3, 3))
    cross[..., 0, 1], cross[..., 0, 2] = -z, y
    cross[..., 1, 0], cross[..., 1, 2] = z, -x
    cross[..., 2, 0], cross[..., 2, 1] = -y, x
    half = 0.5 * angle
    sine = np.sinc(angle / np.pi)
    cosine = 0.5 * np.sinc(half / np.pi) ** 2
    return np.asarray(np.eye(3) + sine * cross + cosine * (cross @ cross))
