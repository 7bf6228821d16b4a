"""Trajectories of polynomials of degree five: B-splines from rest to rest, and quintics between given instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import real_array
from steelyard.once import cached_property

from .trajectory import SampledTrajectory, times_of

__all__ = ["QuinticTrajectory", "SplineTrajectory", "hermite", "splines"]

Array = NDArray[np.float64]

DEGREE = 5


def splines(points: Array, duration: float) -> tuple[Any, Any, Any]:
    """Return B-splines of degree five and their first and second derivatives, as functions of times from 0 to an end.

    The knots are evenly spaced, with the first and the last control point as ends of the curve.

    Parameters
    ----------
    points : ndarray
        (N, P) control points, P at least 6.
    duration : float
        s.
    """
    from scipy.interpolate import BSpline

    inner = np.linspace(0.0, duration, points.shape[1] - DEGREE + 1)
    knots = np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, duration)])
    spline = BSpline(knots, points.T, DEGREE)
    return spline, spline.derivative(1), spline.derivative(2)


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
        object.__setattr__(self, "points", np.array(real_array(self.points, "points of a spline")))
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
        whole = np.concatenate([self.points[:, [0, 0]], self.points, self.points[:, [-1, -1]]], axis=1)
        return splines(whole, self.duration)

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


# Each row holds the coefficients of the powers 0 to 5 of u in one of the six Hermite polynomials of degree five on 0 to
# 1. They have one as value, first or second derivative at u = 0, then at u = 1, and zero for the other five.
_HERMITE = np.array(
    [
        [1.0, 0.0, 0.0, -10.0, 15.0, -6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
        [0.0, 0.0, 0.0, 10.0, -15.0, 6.0],
        [0.0, 0.0, 0.0, -4.0, 7.0, -3.0],
        [0.0, 0.0, 0.0, 0.5, -1.0, 0.5],
    ]
)


def hermite(u: Array, span: Array) -> tuple[Array, Array, Array]:
    """Return the weights of q, dq, ddq at both ends of an interval, and their time derivatives, (S, 6) each.

    Parameters
    ----------
    u : ndarray
        (S,) relative position in the interval, 0 to 1.
    span : ndarray
        (S,) length of the interval, s.
    """
    powers = np.arange(6)
    results = []
    for order in range(3):
        factor = np.ones(6)
        for k in range(order):
            factor = factor * (powers - k)
        shape = u[:, None] ** np.maximum(powers - order, 0) * factor
        # Derivatives by u are derivatives by time times powers of the span.
        size = span[:, None] ** (np.array([0, 1, 2, 0, 1, 2]) - order)
        results.append(shape @ _HERMITE.T * size)
    return results[0], results[1], results[2]


@dataclass(frozen=True, eq=False)
class QuinticTrajectory(SampledTrajectory):
    """A motion given at some instants, with polynomials of degree five between and two continuous derivatives.

    Attributes
    ----------
    times : ndarray
        (K,) instants, increasing from 0, s; K is at least 2.
    q, dq, ddq : ndarray
        (K, N) positions, velocities and accelerations at these instants.

    Examples
    --------
    >>> trajectory = QuinticTrajectory.point_to_point([[0.0], [1.0]], [2.0])
    >>> q, dq, ddq = trajectory.motion([0.0, 1.0, 2.0])
    >>> q.ravel().tolist(), dq.ravel().tolist()
    ([0.0, 0.5, 1.0], [0.0, 0.9375, 0.0])
    """

    times: Array
    q: Array
    dq: Array
    ddq: Array

    def __post_init__(self) -> None:
        for name in ("times", "q", "dq", "ddq"):
            object.__setattr__(self, name, np.array(real_array(getattr(self, name), f"{name} of a motion")))
        shape = self.q.shape
        fits = self.q.ndim == 2 and self.dq.shape == shape == self.ddq.shape and self.times.shape == shape[:1]
        if not fits or len(self.times) < 2:
            raise InputError(
                "A quintic trajectory needs times of shape (K,) with K at least 2, and q, dq, ddq of shape (K, N), got "
                f"{self.times.shape}, {self.q.shape}, {self.dq.shape} and {self.ddq.shape}."
            )
        for name in ("times", "q", "dq", "ddq"):
            bad = np.argwhere(~np.isfinite(getattr(self, name)))
            if len(bad):
                raise InputError(f"{name} of a quintic trajectory must be finite, but row {bad[0, 0] + 1} is not.")
        steps = np.diff(self.times)
        if self.times[0] != 0.0 or np.any(steps <= 0.0):
            place = 0 if self.times[0] != 0.0 else int(np.argmax(steps <= 0.0)) + 1
            raise InputError(
                "times of a quintic trajectory must increase from 0, in s, but that of row "
                f"{place + 1} is {self.times[place]:g}."
            )

    @classmethod
    def point_to_point(cls, points: ArrayLike, spans: ArrayLike | Sequence[float]) -> QuinticTrajectory:
        """Return a motion from point to point that rests at each point.

        Parameters
        ----------
        points : array_like
            (K, N) positions, rad or m.
        spans : array_like
            (K - 1,) durations of the moves, s.
        """
        places = real_array(points, "points of a point-to-point motion")
        lengths = real_array(spans, "spans of a point-to-point motion")
        if places.ndim != 2 or lengths.shape != (len(places) - 1,):
            raise InputError(
                "Point-to-point motion needs points of shape (K, N) and K - 1 durations, "
                f"got {places.shape} and {lengths.shape}."
            )
        still = np.zeros_like(places)
        return cls(np.concatenate([[0.0], np.cumsum(lengths)]), places, still, still)

    def __repr__(self) -> str:
        return f"QuinticTrajectory({self.dof} joints, {len(self.times)} points, {self.duration:g} s)"

    @property
    def duration(self) -> float:
        """Time of the last point, s."""
        return float(self.times[-1])

    @property
    def dof(self) -> int:
        """Number N of joints."""
        return int(self.q.shape[1])

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (S, N) each, at times (S,); at rest before the start and after the end."""
        given = times_of(t)
        times = np.clip(given, 0.0, self.duration)
        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        span = np.diff(self.times)[k]
        ends = np.stack([a[k + step] for step in (0, 1) for a in (self.q, self.dq, self.ddq)], axis=1)
        q, dq, ddq = (
            np.einsum("si,sin->sn", weights, ends) for weights in hermite((times - self.times[k]) / span, span)
        )
        outside = given != times
        dq[outside] = ddq[outside] = 0.0
        return q, dq, ddq

    def to_dict(self) -> dict[str, Any]:
        """Return the instants and the motion at them as plain data."""
        return {"family": "quintic", **{name: getattr(self, name).tolist() for name in ("times", "q", "dq", "ddq")}}
