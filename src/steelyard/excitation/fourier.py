"""Periodic excitation trajectories as finite Fourier series, and their ramps from rest and to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.files.arguments import real_array

from .trajectory import SampledTrajectory, times_of

__all__ = ["FourierTrajectory", "RestToRestTrajectory", "ramp_phase"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FourierTrajectory(SampledTrajectory):
    """A trajectory whose joint velocities are Fourier series (thesis eq. 4.19, 4.20; Swevers et al. 1997).

    ``dq_k(t) = sum_i a_ki cos(w i t) + b_ki sin(w i t)`` with ``w = 2 pi frequency`` and i from 1 to H.

    Attributes
    ----------
    a, b : ndarray
        (N, H) coefficients, rad/s or m/s.
    center : ndarray
        (N,) constant of the position of each joint, rad or m.
    frequency : float
        Frequency of the fundamental, Hz.

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
            object.__setattr__(self, name, np.array(real_array(getattr(self, name), f"{name} of a Fourier trajectory")))
        if self.a.ndim != 2 or self.a.shape != self.b.shape or self.center.shape != self.a.shape[:1]:
            raise InputError(
                f"A Fourier trajectory needs a and b of one shape (N, H) and center of shape (N,), got {self.a.shape}, "
                f"{self.b.shape} and {self.center.shape}."
            )
        if not self.frequency > 0.0:
            raise InputError(f"frequency must be positive, in Hz, got {self.frequency}.")

    def __repr__(self) -> str:
        return f"FourierTrajectory({self.dof} joints, {self.harmonics} harmonics, period {self.period:g} s)"

    @property
    def period(self) -> float:
        """Duration of one period, s."""
        return 1.0 / self.frequency

    @property
    def duration(self) -> float:
        """Duration of one period, s; the motion is also defined before and after it."""
        return self.period

    @property
    def dof(self) -> int:
        """Number N of joints."""
        return len(self.center)

    @property
    def harmonics(self) -> int:
        """Number H of harmonics."""
        return int(self.a.shape[1])

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (S, N) each, at times (S,)."""
        times = np.asarray(t, dtype=np.float64)
        w = 2.0 * np.pi * self.frequency * np.arange(1, self.a.shape[1] + 1)
        phase = times[:, None] * w
        sine, cosine = np.sin(phase), np.cos(phase)
        q = sine @ (self.a / w).T - cosine @ (self.b / w).T + self.center
        return q, cosine @ self.a.T + sine @ self.b.T, cosine @ (self.b * w).T - sine @ (self.a * w).T

    def sample(self, rate: float, periods: float = 1.0) -> tuple[Array, Array, Array, Array]:
        """Return t (S,), q, dq and ddq (S, N) of whole periods at `rate` (Hz), without the end point."""
        t = np.arange(round(periods * self.period * rate)) / rate
        return (t, *self.motion(t))

    def to_dict(self) -> dict[str, Any]:
        """Return the coefficients as plain data."""
        arrays = {name: getattr(self, name).tolist() for name in ("a", "b", "center")}
        return {"family": "fourier", **arrays, "frequency": self.frequency}


def ramp_phase(u: Array) -> tuple[Array, Array, Array]:
    """Return the phase of a ramp-up from rest, relative to the ramp time, and its first and second derivative.

    The speed rises as ``6 u^5 - 15 u^4 + 10 u^3``, so that speed and acceleration are continuous at both ends.

    Parameters
    ----------
    u : ndarray
        Time relative to the ramp time, 0 to 1.

    Returns
    -------
    tuple of ndarray
        The phase, from 0 to 1/2; its derivative, from 0 to 1; and its second derivative.
    """
    return (
        u**4 * (u * (u - 3.0) + 2.5),
        u**3 * (u * (6.0 * u - 15.0) + 10.0),
        30.0 * u**2 * (1.0 - u) ** 2,
    )


SLOW_PACE = 0.05
"""Speed of a slow passage, relative to that of the series: joints with a limit of 3 rad/s then turn around at speeds
below 0.15 rad/s, where Stribeck's friction and presliding are. With 0.1 the least standard error of the ratio of
LuGre's friction was 40 % larger on simulated arms, and that of its velocity 14 % smaller."""


@dataclass(frozen=True, eq=False)
class RestToRestTrajectory(SampledTrajectory):
    """Whole periods of a Fourier series with a ramp from rest and a ramp to rest (thesis section 4.3.3).

    During the ramp-up the joints move along the path of the series with a speed that rises from zero, and during the
    ramp-down it falls in the same way. The ramps therefore contain no positions outside the path of the series and no
    larger velocities; positions, velocities and accelerations are continuous.

    With `slow_time` each period is followed by a slow passage: within `ramp_time` the speed falls to a twentieth, stays
    there for `slow_time`, and rises again, along the same path. Joints that turn around in it do so slowly, which
    shows friction near rest. Each passage begins where the one before ended, so that several go through all the path.

    Attributes
    ----------
    series : FourierTrajectory
    ramp_time : float
        Duration of the ramp-up, and of the ramp-down, s.
    periods : int
        Number of whole periods between the ramps.
    slow_time : float
        Duration of each slow passage, s, without the ramps about it; 0 for none.

    Examples
    --------
    >>> one = np.ones((1, 1))
    >>> series = FourierTrajectory(a=one, b=0 * one, center=np.zeros(1), frequency=0.5)
    >>> trajectory = RestToRestTrajectory(series, ramp_time=1.0, periods=3)
    >>> trajectory.duration
    8.0
    >>> q, dq, ddq = trajectory.motion([0.0, 1.0, 8.0])
    >>> abs(dq).ravel().tolist(), bool(abs(ddq).max() < 1e-12)
    ([0.0, 1.0, 0.0], True)
    """

    series: FourierTrajectory
    ramp_time: float
    periods: int = 1
    slow_time: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.slow_time) and self.slow_time >= 0.0):
            raise InputError(f"slow_time must be a time in s, 0 for none, got {self.slow_time!r}.")
        if not (np.isfinite(self.ramp_time) and self.ramp_time > 0.0):
            raise InputError(f"ramp_time must be positive, in s, got {self.ramp_time!r}.")
        if self.periods != int(self.periods) or self.periods < 1:
            raise InputError(f"periods must be a positive whole number, got {self.periods!r}.")
        object.__setattr__(self, "periods", int(self.periods))

    def __repr__(self) -> str:
        slow = f", slow passages of {self.slow_time:g} s" if self.slow_time else ""
        return f"RestToRestTrajectory({self.series!r}, ramps of {self.ramp_time:g} s, {self.periods} periods{slow})"

    @property
    def period(self) -> float:
        """Duration of one period, s."""
        return self.series.period

    @property
    def duration(self) -> float:
        """Duration of ramp-up, periods, slow passages and ramp-down together, s."""
        return 2.0 * self.ramp_time + self.periods * (self.series.period + self._pause)

    @property
    def slow_passages(self) -> tuple[tuple[float, float], ...]:
        """Times at which each slow passage begins and ends, with the ramps about it, s."""
        if not self.slow_time:
            return ()
        whole = self.series.period + self._pause
        ends = [self.ramp_time + (k + 1) * whole for k in range(self.periods)]
        return tuple((end - self._pause, end) for end in ends)

    @property
    def _pause(self) -> float:
        """Duration of a slow passage with the ramps about it, s."""
        return 2.0 * self.ramp_time + self.slow_time if self.slow_time else 0.0

    @property
    def dof(self) -> int:
        """Number N of joints."""
        return self.series.dof

    def phase(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return the time of the series (s) at times (S,), and its first and second derivative."""
        times = times_of(t)
        phase, rate, change = times - self.ramp_time, np.ones_like(times), np.zeros_like(times)
        lost = 0.0  # time of the series
        for begin, finish in self.slow_passages:
            lost = (1.0 - SLOW_PACE) * (self.ramp_time + self.slow_time)
            phase[times >= finish] -= lost
            inside = (times > begin) & (times < finish)
            second = times[inside] > 0.5 * (begin + finish)
            since = np.minimum(times[inside] - begin, finish - times[inside])
            p, r, c = ramp_phase(np.clip(since / self.ramp_time, 0.0, 1.0))
            slowed = (1.0 - SLOW_PACE) * (p * self.ramp_time + np.maximum(since - self.ramp_time, 0.0))
            phase[inside] -= np.where(second, lost - slowed, slowed)
            rate[inside] = 1.0 - (1.0 - SLOW_PACE) * r
            change[inside] = np.where(second, 1.0, -1.0) * (1.0 - SLOW_PACE) * c / self.ramp_time
        stop = self.ramp_time + self.periods * (self.series.period + self._pause)
        end = stop - self.ramp_time - self.periods * lost
        for inside, origin, sign in (
            (times < self.ramp_time, times, 1.0),
            (times > stop, self.duration - times, -1.0),
        ):
            p, r, c = ramp_phase(np.clip(origin[inside] / self.ramp_time, 0.0, 1.0))
            before = (p - 0.5) * self.ramp_time
            phase[inside] = before if sign > 0 else end - before
            rate[inside], change[inside] = r, sign * c / self.ramp_time
        return phase, rate, change

    def motion(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Return q, dq and ddq, (S, N) each, at times (S,); at rest before the start and after the end."""
        phase, rate, change = (x[:, None] for x in self.phase(t))
        q, dq, ddq = self.series.motion(phase[:, 0])
        return q, dq * rate, ddq * rate**2 + dq * change

    def to_dict(self) -> dict[str, Any]:
        """Return the coefficients and the ramps as plain data."""
        slow = {"slow_time": self.slow_time} if self.slow_time else {}
        return {**self.series.to_dict(), "ramp_time": self.ramp_time, "periods": self.periods, **slow}
