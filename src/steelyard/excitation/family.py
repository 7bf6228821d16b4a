"""Families of trajectories that are linear in their coefficients, for the design of excitations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError
from steelyard.files import read_whole
from steelyard.once import cached_property

from .fourier import SLOW_PACE, FourierTrajectory, RestToRestTrajectory
from .spline import QuinticTrajectory, SplineTrajectory, hermite, splines
from .trajectory import Trajectory

__all__ = [
    "FAMILIES",
    "Basis",
    "Family",
    "FourierFamily",
    "PointFamily",
    "QuinticFamily",
    "SplineFamily",
    "make_family",
]

Array = NDArray[np.float64]
Basis = tuple[Array, Array, Array]
"""Basis of q, dq and ddq, (S, P) each: the positions for coefficients X (N, P) are ``basis[0] @ X.T``."""

FAMILIES = ("fourier", "spline", "quintic")


class Family(Protocol):
    """A family of trajectories with coefficients (N, P).

    Attributes
    ----------
    name : str
    size : int
        Number P of coefficients of each joint.
    constant : ndarray
        (P,) coefficients of a joint that rests at position 1.
    period : float
        Duration of the motion to which the criterion applies, s.
    window : (float, float)
        Times in the whole motion at which the first such period begins and ends, s.
    duration : float
        Duration of the whole motion from rest to rest, s.
    step : float
        Time step that resolves the motion, s; the criterion and the limits are evaluated at this step in the search.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def size(self) -> int: ...  # noqa: D102
    @property
    def constant(self) -> Array: ...  # noqa: D102
    @property
    def period(self) -> float: ...  # noqa: D102
    @property
    def window(self) -> tuple[float, float]: ...  # noqa: D102
    @property
    def duration(self) -> float: ...  # noqa: D102
    @property
    def step(self) -> float: ...  # noqa: D102

    def basis(self, t: Array) -> Basis:
        """Return the basis at times (S,) of the whole motion."""
        ...

    def excitation(self, coefficients: Array) -> Trajectory:
        """Return the motion to which the criterion applies, without ramp-up and ramp-down."""
        ...

    def trajectory(self, coefficients: Array) -> Trajectory:
        """Return the whole motion from rest to rest."""
        ...


@dataclass(frozen=True)
class FourierFamily:
    """Fourier series with a ramp-up and a ramp-down; the coefficients are a1 … aH, b1 … bH and the constant.

    Attributes
    ----------
    period : float
        s.
    ramp_time : float
        Duration of the ramp-up and of the ramp-down, s; 0 for none.
    periods : int
        Number of periods.
    slow_time : float
        Duration of a slow passage after each period, s; 0 for none.
    """

    period: float
    harmonics: int
    ramp_time: float
    periods: int = 1
    slow_time: float = 0.0
    name: str = "fourier"

    @property
    def size(self) -> int:
        """Number of coefficients of each joint."""
        return 2 * self.harmonics + 1

    @cached_property
    def constant(self) -> Array:
        """Coefficients of a joint that stands at 1."""
        return np.asarray(np.eye(self.size)[-1])

    @property
    def window(self) -> tuple[float, float]:
        """Beginning and end of the first period, s."""
        return self.ramp_time, self.ramp_time + self.period

    @property
    def duration(self) -> float:
        """From rest to rest, s."""
        return self._timing.duration if self.ramp_time > 0.0 else self.period

    @property
    def leads(self) -> tuple[tuple[float, float], ...]:
        """Times at which each change of speed about a slow passage begins and ends, s."""
        if not self.slow_time:
            return ()
        passages, ramp = self._timing.slow_passages, self.ramp_time
        return tuple(ends for a, b in passages for ends in ((a, a + ramp), (b - ramp, b)))

    @property
    def ramps(self) -> tuple[tuple[float, float], ...]:
        """Times at which each change of speed begins and ends, those at the start and the end as well, s."""
        ramp, duration = self.ramp_time, self.duration
        return ((0.0, ramp), (duration - ramp, duration), *self.leads) if ramp else ()

    def telling(self, t: Array) -> NDArray[np.bool_]:
        """Return which instants (S,) in even steps tell something of the limits that others do not.

        Periods after the first one do not, nor do most of the instants of slow passages, which lie a twentieth as far
        apart on the path.
        """
        told = np.ones(len(t), dtype=bool)
        if self.slow_time:
            for begin, end in self._timing.slow_passages:
                slow = (t > begin + self.ramp_time) & (t < end - self.ramp_time)
                told[slow] = np.arange(np.count_nonzero(slow)) % round(1.0 / SLOW_PACE) == 0
                told[(t > end) & (t < end + self.period) & (t < self.duration - self.ramp_time)] = False
        return told

    @cached_property
    def _timing(self) -> RestToRestTrajectory:
        """A motion with the same ramps and passages."""
        still = FourierTrajectory(np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1), 1.0 / self.period)
        return RestToRestTrajectory(still, self.ramp_time, self.periods, self.slow_time)

    @property
    def step(self) -> float:
        """A fortieth of the fastest oscillation, s."""
        return self.period / self.harmonics / 40.0

    def basis(self, t: Array) -> Basis:
        """Return the basis at times (S,) of the whole motion."""
        phase, rate, change = t, np.ones_like(t), np.zeros_like(t)
        if self.ramp_time > 0.0:
            phase, rate, change = self._timing.phase(t)
        w = 2.0 * np.pi / self.period * np.arange(1, self.harmonics + 1)
        sine, cosine = np.sin(phase[:, None] * w), np.cos(phase[:, None] * w)
        one, zero = np.ones((len(t), 1)), np.zeros((len(t), 1))
        q = np.hstack([sine / w, -cosine / w, one])
        dq = np.hstack([cosine, sine, zero])
        ddq = np.hstack([-sine * w, cosine * w, zero])
        rate, change = rate[:, None], change[:, None]
        return q, dq * rate, ddq * rate**2 + dq * change

    def excitation(self, coefficients: Array) -> FourierTrajectory:
        """Return the series."""
        a, b, center = np.split(coefficients, [self.harmonics, 2 * self.harmonics], axis=1)
        return FourierTrajectory(a, b, center[:, 0], 1.0 / self.period)

    def trajectory(self, coefficients: Array) -> Trajectory:
        """Return the series between its ramp-up and ramp-down."""
        series = self.excitation(coefficients)
        if self.ramp_time == 0.0:
            return series
        return RestToRestTrajectory(series, self.ramp_time, self.periods, self.slow_time)


@dataclass(frozen=True)
class PointFamily:
    """Base of the families that are defined by points, which end at rest without a ramp."""

    period: float
    size: int

    @cached_property
    def constant(self) -> Array:
        """Coefficients of a joint that stands at 1."""
        return np.ones(self.size)

    @property
    def window(self) -> tuple[float, float]:
        """Beginning and end of the whole motion, s."""
        return 0.0, self.period

    @property
    def duration(self) -> float:
        """The duration of the whole motion, s."""
        return self.period


@dataclass(frozen=True)
class SplineFamily(PointFamily):
    """B-splines of degree five that end where they began; the coefficients are P control points.

    Attributes
    ----------
    period : float
        s.
    size : int
        Number P of control points.
    """

    name: str = "spline"

    @property
    def step(self) -> float:
        """A sixteenth of the time between two control points, s."""
        return self.period / self.size / 16.0

    def basis(self, t: Array) -> Basis:
        """Return the basis at times (S,)."""
        clipped = np.clip(t, 0.0, self.period)
        folded = []
        for one in splines(np.eye(self.size + 5), self.period):
            values = np.asarray(one(clipped))
            own = values[:, 2 : 2 + self.size].copy()
            own[:, 0] += values[:, 0] + values[:, 1] + values[:, -3:].sum(axis=1)
            folded.append(own)
        return folded[0], folded[1], folded[2]

    def excitation(self, coefficients: Array) -> SplineTrajectory:
        """Return the spline."""
        return SplineTrajectory(np.hstack([coefficients, coefficients[:, :1]]), self.period)

    trajectory = excitation


@dataclass(frozen=True)
class QuinticFamily(PointFamily):
    """Moves of equal duration from point to point and back to the first; the coefficients are the P points.

    Attributes
    ----------
    period : float
        s.
    size : int
        Number P of points, and of moves.
    """

    name: str = "quintic"

    @property
    def step(self) -> float:
        """A twentieth of a move, s."""
        return self.period / self.size / 20.0

    def basis(self, t: Array) -> Basis:
        """Return the basis at times (S,)."""
        span = self.period / self.size
        k = np.clip((t / span).astype(int), 0, self.size - 1)
        rows = np.arange(len(t))
        result = []
        for weights in hermite(np.clip(t / span - k, 0.0, 1.0), np.full(len(t), span)):
            matrix = np.zeros((len(t), self.size))
            matrix[rows, k] = weights[:, 0]
            matrix[rows, (k + 1) % self.size] += weights[:, 3]
            result.append(matrix)
        return result[0], result[1], result[2]

    def excitation(self, coefficients: Array) -> QuinticTrajectory:
        """Return the moves."""
        points = np.vstack([coefficients.T, coefficients[:, 0]])
        return QuinticTrajectory.point_to_point(points, np.full(self.size, self.period / self.size))

    trajectory = excitation


def make_family(
    name: str,
    *,
    period: float,
    harmonics: int,
    points: int | None,
    ramp_time: float | None,
    periods: int,
    slow_time: float = 0.0,
) -> Family:
    """Build a family from the options of a design.

    Parameters
    ----------
    name : {"fourier", "spline", "quintic"}
    period : float
        Period of a Fourier series, or duration of the other motions, s.
    harmonics : int
        Number of harmonics of a Fourier series.
    points : int, optional
        Number of points of splines and moves; ``2 harmonics + 1`` by default.
    ramp_time : float, optional
        Duration of the ramps of a Fourier series, s; by default one oscillation of the highest harmonic.
    periods : int
        Number of periods of a Fourier series.
    slow_time : float
        Duration of a slow passage after each period of a Fourier series, s; 0 for none.

    Raises
    ------
    InputError
        If an option is out of its range, or does not belong to the family.
    """
    if name not in FAMILIES:
        raise InputError(f"family must be one of {', '.join(FAMILIES)}, got {name!r}.")
    if not (np.isfinite(period) and period > 0.0):
        raise InputError(f"period must be positive, in s, got {period!r}.")
    for what, number, least in (("harmonics", harmonics, 1), ("points", points, 3), ("periods", periods, 1)):
        if number is not None:
            read_whole(number, what, least)
    if ramp_time is not None and not (np.isfinite(ramp_time) and ramp_time >= 0.0):
        raise InputError(f"ramp_time must be a time in s, 0 for none, got {ramp_time!r}.")
    if not (np.isfinite(slow_time) and slow_time >= 0.0):
        raise InputError(f"slow_time must be a time in s, 0 for none, got {slow_time!r}.")
    if name == "fourier":
        if points is not None:
            raise InputError("points belong to the families spline and quintic; a Fourier series has harmonics.")
        if ramp_time == 0.0 and (periods > 1 or slow_time):
            raise InputError(
                "several periods need a ramp-up and a ramp-down (ramp_time), and so do slow passages; without them the "
                "motion is one period, which the controller may repeat."
            )
        ramp = period / harmonics if ramp_time is None else ramp_time
        return FourierFamily(period, int(harmonics), ramp, int(periods), float(slow_time))
    if periods != 1 or ramp_time or slow_time:
        raise InputError(
            f"periods, ramp_time and slow_time belong to the family fourier; the family {name} starts and ends at "
            "rest by itself."
        )
    size = 2 * int(harmonics) + 1 if points is None else int(points)
    return SplineFamily(period, size) if name == "spline" else QuinticFamily(period, size)
