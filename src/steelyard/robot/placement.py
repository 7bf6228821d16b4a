"""Constant placements: 4x4 homogeneous matrices whose 0 and ±1 entries are exact.

A placement of frame B in frame A takes the coordinates of a point in B to its coordinates in A. Exact zeros and ones
matter: the expression graph folds them, and an entry of 6e-17 left by `cos(pi/2)` would stay as an operation in each
kernel.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "axis_frame",
    "frozen",
    "inverse",
    "motion_z",
    "quaternion_rotation",
    "rotation_x",
    "rotation_y",
    "rotation_z",
    "rpy_rotation",
    "snapped",
    "translation",
]

Matrix = NDArray[np.float64]

# Sines and cosines of multiples of a right angle, in floating point, miss 0 and ±1 by up to 1e-15 (sin(8 pi) is
# -9.8e-16). No angle that is meant to differ from a right one lies that near to it.
SNAP = 1e-15


def frozen(values: ArrayLike, shape: tuple[int, ...]) -> Matrix:
    """A read-only float copy of `values`, of the given shape, without negative zeros.

    Raises
    ------
    ValueError
        When `values` has another shape.
    """
    array = np.array(values, dtype=float) + 0.0
    if array.shape != shape:
        raise ValueError(f"an array of shape {shape} was expected, got shape {array.shape}")
    array.setflags(write=False)
    return array


def _cos_sin(angle: float) -> tuple[float, float]:
    return _snap(math.cos(angle)), _snap(math.sin(angle))


def _snap(value: float) -> float:
    nearest = float(round(value))
    return nearest + 0.0 if abs(value - nearest) < SNAP else value


def snapped(values: ArrayLike) -> Matrix:
    """The same numbers, with 0 and ±1 in the places of those that miss them by rounding alone."""
    given = np.asarray(values, dtype=float)
    nearest = np.round(given)
    exact = (np.abs(given - nearest) < SNAP) & (np.abs(nearest) <= 1.0)
    return np.where(exact, nearest, given) + 0.0


def rotation_x(angle: float) -> Matrix:
    """Placement (4, 4) turned by `angle` (rad) about x."""
    c, s = _cos_sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]], dtype=float) + 0.0


def rotation_y(angle: float) -> Matrix:
    """Placement (4, 4) turned by `angle` (rad) about y."""
    c, s = _cos_sin(angle)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]], dtype=float) + 0.0


def rotation_z(angle: float) -> Matrix:
    """Placement (4, 4) turned by `angle` (rad) about z.

    Examples
    --------
    >>> import math
    >>> rotation_z(math.pi / 2)[0, 0]
    np.float64(0.0)
    """
    c, s = _cos_sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=float) + 0.0


def translation(x: float, y: float, z: float) -> Matrix:
    """Placement (4, 4) shifted by (x, y, z) metres."""
    placement = np.eye(4)
    placement[:3, 3] = x, y, z
    return placement


def rpy_rotation(roll: float, pitch: float, yaw: float) -> Matrix:
    """Placement (4, 4) of URDF's `rpy`: Rz(yaw) Ry(pitch) Rx(roll), angles in radians."""
    return rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll) + 0.0


def quaternion_rotation(w: float, x: float, y: float, z: float) -> Matrix:
    """The rotation (3, 3) of a unit quaternion.

    Examples
    --------
    >>> quaternion_rotation(0.0, 0.0, 0.0, 1.0).tolist()
    [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ],
        dtype=float,
    )


def motion_z(value: float, rotates: bool) -> Matrix:
    """Placement (4, 4) of a joint's motion: a turn (rad) about z, or a shift (m) along z."""
    return rotation_z(value) if rotates else translation(0.0, 0.0, value)


def inverse(placement: Matrix) -> Matrix:
    """The inverse placement (4, 4)."""
    result = np.eye(4)
    result[:3, :3] = placement[:3, :3].T
    result[:3, 3] = -placement[:3, :3].T @ placement[:3, 3]
    return result + 0.0


def axis_frame(axis: Sequence[float]) -> Matrix:
    """A constant rotation (4, 4) that takes z to the direction of `axis` (3,), which need not be a unit vector.

    Axes along ±x, ±y, ±z give exact permutations; an axis in a coordinate plane keeps that plane's normal exact.

    Raises
    ------
    ValueError
        When the axis has no length.

    Examples
    --------
    >>> axis_frame((0, -2, 0))[:3, :3].tolist()
    [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
    """
    vector = np.array(axis, dtype=float)
    largest = np.abs(vector).max()
    if not largest > 0:
        raise ValueError("the axis has no length")
    # Dividing by the largest entry first keeps tiny and huge axes from under- and overflowing.
    vector /= largest
    vector /= np.linalg.norm(vector)
    vector = snapped(vector)
    result = np.eye(4)
    direction = int(np.argmax(np.abs(vector)))
    if np.count_nonzero(vector) == 1:
        cyclic = np.roll(np.eye(3), direction + 1, axis=0)
        if vector[direction] < 0:
            cyclic = cyclic @ np.diag([1.0, -1.0, -1.0])
        result[:3, :3] = cyclic
        return result + 0.0
    smallest = np.eye(3)[int(np.argmin(np.abs(vector)))]
    first = smallest - (smallest @ vector) * vector
    first /= np.linalg.norm(first)
    result[:3, 0] = first
    result[:3, 1] = np.cross(vector, first)
    result[:3, 2] = vector
    return result + 0.0
