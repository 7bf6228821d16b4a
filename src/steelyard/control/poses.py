"""References for the pose of a tool, and conversions between rotation matrices and rotation vectors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

__all__ = [
    "ConstantPose",
    "PoseFunction",
    "PoseReference",
    "PoseTarget",
    "PoseTrajectory",
    "is_pose",
    "pose_reference",
    "rotation_matrix",
    "rotation_vector",
]

Array = NDArray[np.float64]

_TINY = 1e-150  # keeps a division of zero by zero defined; its square is still a normal number
# Beyond the angle with this cosine (154 degrees) the axis is taken from the symmetric part of the rotation. The
# antisymmetric part, which serves below it, vanishes at half a turn, and its errors grow as one over the sine.
_FAR = -0.9


def rotation_vector(rotation: Array) -> Array:
    """Return the rotation vectors (axis times angle, the logarithm) of rotations, with angles between 0 and pi.

    The result is accurate to rounding errors at all angles, small ones and those near half a turn included.

    Parameters
    ----------
    rotation : ndarray
        (..., 3, 3).

    Returns
    -------
    ndarray
        (..., 3), rad. At half a turn, where two vectors describe the rotation, one of them.

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
    """Return rotation vectors near half a turn, with the axis from the largest column of the symmetric part."""
    symmetric = 0.5 * (rotation + np.swapaxes(rotation, -1, -2)) - cosine[..., None, None] * np.eye(3)
    lengths = np.sum(symmetric * symmetric, axis=-2)
    best = np.argmax(lengths, axis=-1)
    column = np.take_along_axis(symmetric, best[..., None, None], axis=-1)[..., 0]
    axis = column / np.maximum(np.sqrt(np.sum(column * column, axis=-1, keepdims=True)), _TINY)
    turned = np.where(np.sum(axis * sine, axis=-1, keepdims=True) < 0.0, -axis, axis)
    return np.asarray(np.arctan2(size, cosine)[..., None] * turned)


def rotation_matrix(vector: Array) -> Array:
    """Return the rotations of rotation vectors (the exponential, by the formula of Rodrigues).

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


@dataclass(frozen=True, eq=False)
class PoseTarget:
    """Desired pose, twist and acceleration of a tool at one instant, in the base frame.

    Attributes
    ----------
    pose : ndarray
        (..., 4, 4).
    twist : ndarray
        (..., 6), velocity (m/s) before angular velocity (rad/s).
    acceleration : ndarray
        (..., 6), time derivative of the twist.
    """

    pose: Array
    twist: Array
    acceleration: Array


@runtime_checkable
class PoseReference(Protocol):
    """Desired poses and motions of a tool as functions of time."""

    def target(self, t: float) -> PoseTarget:
        """Return what is wanted at a time, s."""


class ConstantPose:
    """A constant pose.

    Parameters
    ----------
    pose : array_like
        (..., 4, 4) in the base frame.

    Raises
    ------
    InputError
        If `pose` is not a pose.
    """

    def __init__(self, pose: ArrayLike) -> None:
        checked = _pose(pose)
        still = np.zeros((*checked.shape[:-2], 6))
        self._target = PoseTarget(checked, still, still)

    def target(self, t: float) -> PoseTarget:
        """Return the pose, at rest."""
        return self._target


class PoseFunction:
    """A motion of the tool given by a function of time.

    Parameters
    ----------
    function : callable
        Returns pose (..., 4, 4), twist (..., 6) and its time derivative (..., 6) for a time (s).
    """

    def __init__(self, function: Callable[[float], Any]) -> None:
        self._function = function

    def target(self, t: float) -> PoseTarget:
        """Return what is wanted at a time, s."""
        found = self._function(t)
        if not isinstance(found, tuple | list) or len(found) != 3:
            raise InputError(
                "A function that is a pose reference must return pose, twist and acceleration as three arrays; at "
                f"{t:g} s it returned {type(found).__name__}."
            )
        pose, twist, acceleration = (np.asarray(array, dtype=np.float64) for array in found)
        return PoseTarget(pose, twist, acceleration)


class PoseTrajectory:
    """Straight lines from pose to pose with a rotation about one axis each, from rest to rest.

    Distance and angle follow the polynomial of degree five whose first and second derivatives are zero at both ends.
    Before the first time and after the last the tool stands still.

    Parameters
    ----------
    times : sequence of float
        (n,) times at which the poses are reached, increasing, s.
    poses : array_like
        (n, 4, 4) in the base frame.

    Raises
    ------
    InputError
        If the times do not increase, or their number differs from that of the poses.

    Examples
    --------
    >>> poses = np.array([np.eye(4), np.eye(4)])
    >>> poses[1, 0, 3] = 0.2
    >>> halfway = PoseTrajectory([0.0, 1.0], poses).target(0.5)
    >>> halfway.pose[:3, 3].tolist(), halfway.twist[0].round(9).tolist()
    ([0.1, 0.0, 0.0], 0.375)
    """

    def __init__(self, times: Sequence[float], poses: ArrayLike) -> None:
        self._times = np.array(times, dtype=np.float64)
        self._poses = _pose(poses)
        if self._times.ndim != 1 or len(self._times) < 2 or self._poses.shape != (len(self._times), 4, 4):
            raise InputError(
                f"A pose trajectory needs at least two times and as many poses, got times of shape {self._times.shape} "
                f"and poses of shape {self._poses.shape}."
            )
        if not np.isfinite(self._times).all() or not (np.diff(self._times) > 0.0).all():
            raise InputError(f"The times of a pose trajectory must increase, got {self._times.tolist()}.")
        turns = self._poses[:, :3, :3]
        self._turns = rotation_vector(turns[1:] @ np.swapaxes(turns[:-1], -1, -2))
        self._ways = np.diff(self._poses[:, :3, 3], axis=0)

    def target(self, t: float) -> PoseTarget:
        """Return what is wanted at a time, s."""
        place = int(np.searchsorted(self._times, t, side="right")) - 1
        if place < 0 or place >= len(self._ways):
            return PoseTarget(self._poses[0 if place < 0 else -1], np.zeros(6), np.zeros(6))
        span = float(self._times[place + 1] - self._times[place])
        x = (t - float(self._times[place])) / span
        share = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        speed = 30.0 * (x * (1.0 - x)) ** 2 / span
        rate = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / span**2
        change = np.concatenate((self._ways[place], self._turns[place]))
        pose = self._poses[place].copy()
        pose[:3, :3] = rotation_matrix(share * self._turns[place]) @ pose[:3, :3]
        pose[:3, 3] += share * self._ways[place]
        return PoseTarget(pose, speed * change, rate * change)


def pose_reference(reference: Any) -> PoseReference:
    """Convert what a user gives to a pose reference: a reference, a pose (..., 4, 4), or a function of time.

    Raises
    ------
    InputError
        If `reference` is none of these.
    """
    if isinstance(reference, PoseReference):
        return reference
    if callable(reference):
        return PoseFunction(reference)
    return ConstantPose(reference)


def _pose(pose: ArrayLike) -> Array:
    try:
        found = np.array(pose, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            "A pose reference must be a pose (4, 4), a PoseTrajectory, or a function from a time to pose, twist and "
            f"acceleration, got {type(pose).__name__}."
        ) from None
    if found.shape[-2:] != (4, 4):
        raise InputError(f"A pose must have shape (..., 4, 4), got {found.shape}.")
    if not is_pose(found):
        raise InputError("A pose must consist of a rotation matrix, a position and the last row 0 0 0 1.")
    return found


def is_pose(matrices: Array) -> bool:
    """Return whether matrices (..., 4, 4) all consist of a rotation, a finite position and the last row 0 0 0 1.

    Examples
    --------
    >>> is_pose(np.eye(4)), is_pose(np.diag([1.0, 1.0, -1.0, 1.0]))
    (True, False)
    """
    turn = matrices[..., :3, :3]
    orthogonal = np.allclose(turn @ np.swapaxes(turn, -1, -2), np.eye(3), atol=1e-6)
    ends = np.all(matrices[..., 3, :] == [0.0, 0.0, 0.0, 1.0])
    return bool(orthogonal and ends and np.all(np.linalg.det(turn) > 0.0) and np.isfinite(matrices).all())
