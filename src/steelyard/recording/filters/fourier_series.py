"""Fourier series fitted to a periodic motion, whose period is found in the positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .motion_filter import Array, Motion, MotionFilter, Response, above, whole

__all__ = ["FourierFit", "FourierSeries", "Period", "find_period"]

MOST_HARMONICS = 60
"""Harmonics at most where neither their number nor a cutoff is stated."""
FALSE_ALARM = 1e-3
"""Probability with which noise alone would be taken for a harmonic."""
REPEATS = 0.02
"""Largest squared difference of positions one period apart, as a fraction of that of unrelated ones."""
LEAST_OVERLAP = 0.2
"""Share of the log that still overlaps with itself at the longest lag."""


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
                object.__setattr__(self, name, above(0.0, getattr(self, name), f"{where}, key {name!r},", what))
        if self.harmonics is not None:
            whole(self.harmonics, 1, 1000, f"{where}, key 'harmonics',")

    def settled(self, cutoff: float | None, order: int, where: str) -> Self:
        """See `MotionFilter.settled`; the cutoff of [processing] plays no part."""
        return self

    def series(self, t: ArrayLike, q: ArrayLike, source: str = "recording") -> FourierSeries:
        """Fit the series to positions (S, N) at times (S,).

        Raises
        ------
        InputError
            Where the log is shorter than a period, no period is found, or the rate is too low for the harmonics.
        """
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


@dataclass(frozen=True, eq=False)
class Period:
    """The result of `find_period`.

    Attributes
    ----------
    period : float
        s.
    difference : float
        Root mean square change of the positions after one period, as a fraction of their standard deviation: 0 for a
        motion that repeats itself exactly.
    """

    period: float
    difference: float


def find_period(t: ArrayLike, q: ArrayLike, source: str = "recording") -> Period:
    """Find the period of positions (S, N) at nearly even times (S,).

    The mean squared difference between the motion and itself after a lag is computed for all lags by Fourier
    transforms. The period is the first lag at which it falls to almost nothing, refined by a parabola at the greatest
    multiple that the log holds.

    Raises
    ------
    InputError
        Where no lag of up to 80 % of the log brings the motion back.

    Examples
    --------
    >>> t = np.arange(4000) / 1000.0
    >>> q = np.column_stack([np.sin(2 * np.pi * t / 1.2345), np.cos(4 * np.pi * t / 1.2345)])
    >>> round(find_period(t, q).period, 5)
    1.2345
    """
    times, values = np.asarray(t, dtype=np.float64), np.asarray(q, dtype=np.float64)
    count = len(times)
    if count < 16:
        raise InputError(f"{source} has {count} rows, too few to find a period in; state `period`.")
    step = float(times[-1] - times[0]) / (count - 1)
    spread = values.std(axis=0)
    moving = spread > 1e-3 * spread.max(initial=0.0)
    if not moving.any() or spread.max() < 1e-9:
        raise InputError(f"{source}: no joint moves, so that there is no period.")
    scaled = (values[:, moving] - values[:, moving].mean(axis=0)) / spread[moving]
    longest = int((1.0 - LEAST_OVERLAP) * count)
    curve = _differences(scaled, longest)
    period = _first_return(curve)
    if period is None:
        best = float(np.sqrt(curve[longest // 10 :].min() / 2.0))
        raise InputError(
            f"{source}: no period was found, the motion comes back to {best:.1%} of its spread at best; record two "
            "periods at "
            "least, leave start and stop out with `trim`, or state `period`."
        )
    # A lag of several periods shows the period that much more exactly; each step corrects what it knows so far.
    multiple = 1
    while True:
        centre = round(multiple * period)
        near = np.arange(max(1, centre - 3), min(longest, centre + 4))
        if len(near) >= 5:
            a, b, _ = np.polyfit(near - centre, curve[near], 2)
            if a > 0.0 and abs(b / (2.0 * a)) <= 3.0:
                period = (centre - b / (2.0 * a)) / multiple
        following = min(2 * multiple, int((longest - 4) / period))
        if following <= multiple:
            break
        multiple = following
    difference = float(np.sqrt(max(curve[min(round(period), longest - 1)], 0.0)))
    return Period(float(period * step), difference)


def _differences(x: Array, longest: int) -> Array:
    """(L,) mean over joints and rows of ``|x[k + lag] - x[k]|²``."""
    count = len(x)
    size = 1 << (2 * count - 1).bit_length()
    products = np.fft.irfft((np.abs(np.fft.rfft(x, n=size, axis=0)) ** 2).sum(axis=1), n=size)[:longest]
    squares = np.concatenate([[0.0], np.cumsum(np.sum(x**2, axis=1))])
    lags = np.arange(longest)
    both = squares[count - lags] + (squares[-1] - squares[lags])
    return np.asarray((both - 2.0 * products) / ((count - lags) * x.shape[1]))


def _first_return(curve: Array) -> float | None:
    """The first lag, after the motion has gone away, at a minimum that is near zero."""
    away = np.flatnonzero(curve > 0.5)
    if not len(away):
        return None
    begin = int(away[0])
    low = np.flatnonzero(curve[begin:] < 2.0 * REPEATS) + begin
    if not len(low):
        return None
    ends = np.flatnonzero(np.diff(low) > 1)
    valley = low[: int(ends[0]) + 1] if len(ends) else low
    return float(valley[int(np.argmin(curve[valley]))])
