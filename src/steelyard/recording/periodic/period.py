"""The period of a motion that repeats itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

__all__ = ["Period", "find_period"]

Array = NDArray[np.float64]
REPEATS = 0.02
"""Largest squared difference of positions one period apart, as a fraction of that of unrelated ones."""
LEAST_OVERLAP = 0.2


@dataclass(frozen=True, eq=False)
class Period:
    """What `find_period` found.

    Attributes
    ----------
    period : float
        s.
    difference : float
        Root mean square change of the positions after one period, as a fraction of their standard deviation: 0 for a
        motion that repeats itself exactly.
    lags, curve : ndarray
        (L,) s, and that change after each lag.
    """

    period: float
    difference: float
    lags: Array
    curve: Array


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
    return Period(
        float(period * step),
        difference,
        np.asarray(np.arange(longest) * step, dtype=np.float64),
        np.sqrt(np.maximum(curve, 0.0)),
    )


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
    low = np.flatnonzero(curve[begin:] < max(2.0 * REPEATS, 0.0)) + begin
    if not len(low):
        return None
    ends = np.flatnonzero(np.diff(low) > 1)
    valley = low[: int(ends[0]) + 1] if len(ends) else low
    return float(valley[int(np.argmin(curve[valley]))])
