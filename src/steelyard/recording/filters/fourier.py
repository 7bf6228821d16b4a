"""Fourier series fitted to a periodic motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .motion_filter import Array, Motion, MotionFilter, Response, positive, whole

__all__ = ["FourierFit", "FourierSeries"]

MOST_HARMONICS = 60
FALSE_ALARM = 1e-3
"""Probability with which noise alone would be taken for a harmonic."""


@dataclass(frozen=True, eq=False)
class FourierSeries:
    """A series fitted to positions by least squares.

    Attributes
    ----------
    period : float
        s.
    harmonics : int
        H.
    coefficients : ndarray
        (1 + 2 H, N): constant, then cosine and sine of each harmonic, rad or m.
    noise : ndarray
        (N,) standard deviation of what the series leaves.
    """

    period: float
    harmonics: int
    coefficients: Array
    noise: Array

    def motion(self, t: ArrayLike) -> Motion:
        """Positions and their exact derivatives at times (S,), (S, N) each."""
        times = np.asarray(t, dtype=np.float64)
        w = 2.0 * np.pi / self.period * np.arange(1, self.harmonics + 1)
        cosine, sine = np.cos(np.outer(times, w)), np.sin(np.outer(times, w))
        a, b = self.coefficients[1::2], self.coefficients[2::2]
        w = w[:, None]
        return Motion(
            self.coefficients[0] + cosine @ a + sine @ b,
            cosine @ (w * b) - sine @ (w * a),
            -cosine @ (w**2 * a) - sine @ (w**2 * b),
        )


@dataclass(frozen=True)
class FourierFit(MotionFilter):
    """Least-squares Fourier series of a periodic motion; its derivatives are exact.

    What is periodic passes unchanged up to the highest harmonic, all else is averaged out over the whole log: no filter
    suppresses more noise, and none has less bias, where the motion is periodic. Where it is not (start and stop, a
    collision, a period that is off by 1e-4) the series is wrong: leave those rows out with `trim`.

    Parameters
    ----------
    period
        s; None finds it in the positions, which must show two periods at least.
    harmonics
        Highest harmonic; None takes the highest that stands out of the noise in any joint, at most 60 or up to the
        cutoff where one is stated here.
    cutoff
        Hz, above which no harmonics are taken.

    References
    ----------
    J. Swevers et al., Optimal robot excitation and identification, IEEE Trans. Robotics and Automation 13, 1997.

    Examples
    --------
    >>> t = np.arange(3000) / 1000.0
    >>> q = np.sin(2.0 * np.pi * t)[:, None] + 0.2 * np.cos(6.0 * np.pi * t)[:, None]
    >>> series = FourierFit(period=1.0).series(t, q)
    >>> series.harmonics, np.abs(series.coefficients).round(6).ravel().tolist()
    (3, [0.0, 0.0, 1.0, 0.0, 0.0, 0.2, 0.0])
    """

    kind: ClassVar[str] = "fourier"
    needs_whole_log: ClassVar[bool] = True
    takes_uneven_times: ClassVar[bool] = True

    period: float | None = None
    harmonics: int | None = None
    cutoff: float | None = None

    def _clean(self, where: str) -> None:
        for name, what in (("period", "a time in s"), ("cutoff", "a frequency in Hz")):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, positive(getattr(self, name), f"{where}, key {name!r},", what))
        if self.harmonics is not None:
            whole(self.harmonics, 1, 1000, f"{where}, key 'harmonics',")

    def settled(self, cutoff: float | None, order: int, where: str) -> Self:
        """See `MotionFilter.settled`; the cutoff of [processing] plays no part."""
        return replace(self)

    def series(self, t: ArrayLike, q: ArrayLike, source: str = "recording") -> FourierSeries:
        """Fit the series to positions (S, N) at times (S,).

        Raises
        ------
        InputError
            Where the log is shorter than a period, no period is found, or the rate is too low for the harmonics.
        """
        from ..periodic.period import find_period

        times, values = np.asarray(t, dtype=np.float64), np.asarray(q, dtype=np.float64)
        period = find_period(times, values, source).period if self.period is None else self.period
        span = float(times[-1] - times[0]) * len(times) / (len(times) - 1)
        if span < 0.999 * period:
            raise InputError(
                f"{source} lasts {span:.6g} s, less than the period of {period:.6g} s; record a whole period at least."
            )
        rate = (len(times) - 1) / float(times[-1] - times[0])
        highest = int(0.4 * rate * period)
        if self.harmonics is not None:
            if self.harmonics > highest:
                raise InputError(
                    f"{source} is sampled at {rate:.6g} Hz, enough for {highest} harmonics of {1.0 / period:.4g} Hz, "
                    "not "
                    f"for {self.harmonics}; lower `harmonics`."
                )
            count = self.harmonics
        else:
            limit = MOST_HARMONICS if self.cutoff is None else int(self.cutoff * period + 1e-9)
            count = max(1, min(limit, highest))
        coefficients, noise = _fitted(times, values, period, count)
        if self.harmonics is None:
            found = _last_distinct(coefficients, noise, len(times))
            if found < count:
                count = found
                coefficients, noise = _fitted(times, values, period, count)
        return FourierSeries(period, count, coefficients, noise)

    def motion(self, t: Array, q: Array, rate: float, source: str) -> Motion:
        """See `MotionFilter.motion`."""
        known = np.isfinite(q).all(axis=1)
        return self.series(t[known], q[known], source).motion(t)

    def settling(self, rate: float) -> float:
        """See `MotionFilter.settling`: a series has no ends."""
        return 0.0

    def response(self, frequencies: ArrayLike, rate: float) -> Response:
        """See `MotionFilter.response`: 1 at the harmonics, 0 elsewhere, over a log of infinitely many periods."""
        if self.period is None or self.harmonics is None:
            raise InputError("the response of a Fourier fit needs its `period` and `harmonics`.")
        f = np.asarray(frequencies, dtype=np.float64) * self.period
        near = (np.abs(f - np.round(f)) < 1e-9 * np.maximum(1.0, f)) & (np.round(f) <= self.harmonics)
        gain = near.astype(np.float64)
        return Response(gain, gain, gain)


def _fitted(t: Array, q: Array, period: float, harmonics: int) -> tuple[Array, Array]:
    """Coefficients (1 + 2 H, N) and the deviation of the rest, (N,)."""
    phase = 2.0 * np.pi / period * np.outer(t, np.arange(1, harmonics + 1))
    columns = np.ones((len(t), 1 + 2 * harmonics))
    columns[:, 1::2], columns[:, 2::2] = np.cos(phase), np.sin(phase)
    # The columns are all but orthogonal over a period or more: normal equations, once refined, lose nothing.
    gram = columns.T @ columns
    coefficients = np.linalg.solve(gram, columns.T @ q)
    coefficients += np.linalg.solve(gram, columns.T @ (q - columns @ coefficients))
    rest = q - columns @ coefficients
    free = max(len(t) - columns.shape[1], 1)
    return np.asarray(coefficients), np.asarray(np.sqrt(np.sum(rest**2, axis=0) / free))


def _last_distinct(coefficients: Array, noise: Array, count: int) -> int:
    """The highest harmonic whose power noise alone would hardly reach."""
    power = coefficients[1::2] ** 2 + coefficients[2::2] ** 2
    # Squared amplitudes of white noise are exponential with the mean 4 sigma² / S.
    limit = 4.0 * noise**2 / count * np.log(power.size / FALSE_ALARM) + (1e-12 * np.abs(coefficients).max(axis=0)) ** 2
    distinct: NDArray[np.bool_] = (power > limit).any(axis=1)
    return int(np.flatnonzero(distinct)[-1]) + 1 if distinct.any() else 1
