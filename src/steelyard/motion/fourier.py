"""Periodic excitation trajectories as finite Fourier series."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

__all__ = ["FourierTrajectory"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Joint positions as Fourier series of their velocities (thesis eq. 4.19, 4.20; Swevers et al. 1997).

    ``dq_k(t) = sum_i a_ki cos(w i t) + b_ki sin(w i t)`` with ``w = 2 pi frequency`` and i from 1 to H.

    Attributes
    ----------
    a, b : ndarray
        (N, H) coefficients, rad/s or m/s.
    center : ndarray
        (N,) constant of each series, rad or m.
    frequency : float
        Hz, of the fundamental.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> trajectory = FourierTrajectory(a=one, b=0 * one, center=np.array([0.5]), frequency=1.0)
    >>> q, dq, ddq = trajectory.motion([0.0])
    >>> q.tolist(), dq.tolist()
    ([[0.5]], [[1.0]])
    """

    a: Array
    b: Array
    center: Array
    frequency: float

    def __post_init__(self) -> None:
        for name in ("a", "b", "center"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        if self.a.ndim != 2 or self.a.shape != self.b.shape or self.center.shape != self.a.shape[:1]:
            raise InputError(
                f"A Fourier trajectory needs a and b of one shape (N, H) and center of shape (N,), got {self.a.shape}, "
                f"{self.b.shape} and {self.center.shape}."
            )
        if not self.frequency > 0.0:
            raise InputError(f"frequency must be positive, in Hz, got {self.frequency}.")

    @property
    def period(self) -> float:
        """Duration of one period, s."""
        return 1.0 / self.frequency

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (S, N) each, at times (S,)."""
        times = np.asarray(t, dtype=np.float64)
        w = 2.0 * np.pi * self.frequency * np.arange(1, self.a.shape[1] + 1)
        phase = times[:, None] * w
        sine, cosine = np.sin(phase), np.cos(phase)
        q = sine @ (self.a / w).T - cosine @ (self.b / w).T + self.center
        return q, cosine @ self.a.T + sine @ self.b.T, cosine @ (self.b * w).T - sine @ (self.a * w).T

    def sample(self, rate: float, periods: float = 1.0) -> tuple[Array, Array, Array, Array]:
        """Return t (S,), q, dq and ddq (S, N) of whole periods at `rate` Hz, without the end point."""
        t = np.arange(round(periods * self.period * rate)) / rate
        return (t, *self.motion(t))
