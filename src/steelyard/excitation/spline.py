"""Trajectories of B-splines of degree five, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .trajectory import SampledTrajectory, times_of

__all__ = ["DEGREE", "SplineTrajectory", "clamped_knots"]

Array = NDArray[np.float64]
DEGREE = 5


def clamped_knots(count: int, duration: float) -> Array:
    """Return evenly spaced knots for `count` control points, with the first and last point as ends of the curve."""
    inner = np.linspace(0.0, duration, count - DEGREE + 1)
    return np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, duration)])


@dataclass(frozen=True, eq=False)
class SplineTrajectory(SampledTrajectory):
    """A trajectory of B-splines of degree five with evenly spaced knots and four continuous derivatives.

    The first and the last control point of each joint are repeated three times, so that the motion starts and ends at
    rest with zero acceleration.

    Attributes
    ----------
    points : ndarray
        (N, P) control points without the repetitions, rad or m; P is at least 2.
    duration : float
        Duration, s.

    Examples
    --------
    >>> trajectory = SplineTrajectory(points=np.array([[0.0, 1.0, 0.0]]), duration=4.0)
    >>> q, dq, ddq = trajectory.motion([0.0, 2.0, 4.0])
    >>> q[[0, 2]].ravel().tolist(), bool(abs(dq).max() < 1e-12), bool(abs(ddq[[0, 2]]).max() < 1e-12)
    ([0.0, 0.0], True, True)
    """

    points: Array
    duration: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", np.array(self.points, dtype=np.float64))
        if self.points.ndim != 2 or self.points.shape[1] < 2 or not np.isfinite(self.points).all():
            raise InputError(
                "A spline trajectory needs finite control points of shape (N, P) with P at least 2, "
                f"got shape {self.points.shape}."
            )
        if not (np.isfinite(self.duration) and self.duration > 0.0):
            raise InputError(f"duration must be positive, in s, got {self.duration!r}.")

    def __repr__(self) -> str:
        return f"SplineTrajectory({self.dof} joints, {self.points.shape[1]} points, {self.duration:g} s)"

    @property
    def dof(self) -> int:
        """Number N of joints."""
        return len(self.points)

    @cached_property
    def _splines(self) -> tuple[Any, Any, Any]:
        from scipy.interpolate import BSpline

        whole = np.concatenate([self.points[:, [0, 0]], self.points, self.points[:, [-1, -1]]], axis=1)
        spline = BSpline(clamped_knots(whole.shape[1], self.duration), whole.T, DEGREE)
        return spline, spline.derivative(1), spline.derivative(2)

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (S, N) each, at times (S,); at rest before the start and after the end."""
        times = times_of(t)
        inside = ((times > 0.0) & (times < self.duration))[:, None]
        clipped = np.clip(times, 0.0, self.duration)
        q, dq, ddq = (np.asarray(s(clipped), dtype=np.float64) for s in self._splines)
        return q, np.where(inside, dq, 0.0), np.where(inside, ddq, 0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the control points and the duration as plain data."""
        return {"family": "spline", "points": self.points.tolist(), "duration": self.duration}
