"""Averages over the periods of a motion, with the noise that the spread of the periods shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.display import html_table
from steelyard.errors import InputError

from .filters import FourierFit, FourierSeries
from .measurements import Measurements
from .samples import Samples

__all__ = ["PeriodicAverage", "average_periods"]

Array = NDArray[np.float64]

SLIP = 0.05
"""The share of a row by which the last period may stand off the grid of the first before torques are interpolated."""


@dataclass(frozen=True, eq=False)
class PeriodicAverage:
    """One period of a motion, averaged over all periods by `average_periods`.

    Attributes
    ----------
    samples : Samples
        One period: motion from the Fourier series of all periods, torque averaged over them.
    series : FourierSeries
    periods : int
        P, how many were averaged.
    position_deviation, torque_deviation : ndarray
        (N,) standard deviations of single rows about the average: the noise that the periods do not share.
    torque_covariance : ndarray
        (N, N) of the noise of single rows across the joints.
    torques : ndarray
        (P, S, N) of each period; NaN where they were missing.
    """

    samples: Samples
    series: FourierSeries
    periods: int
    position_deviation: Array
    torque_deviation: Array
    torque_covariance: Array
    torques: Array

    @property
    def covariance(self) -> Array:
        """(N, N) of the noise of the averaged torques, for ``Information.from_samples(..., covariance=...)``."""
        return self.torque_covariance / self.periods

    def __repr__(self) -> str:
        noise = ", ".join(f"{value:.3g}" for value in self.torque_deviation)
        return (
            f"PeriodicAverage({self.periods} periods of {self.series.period:.6g} s, {self.series.harmonics} harmonics, "
            f"torque noise {noise})"
        )

    def _repr_html_(self) -> str:
        heads = ("joint", "noise of the position", "noise of the torque", "of the average")
        pairs = zip(self.position_deviation, self.torque_deviation, strict=True)
        rows = [
            (j, f"{a:.3g}", f"{b:.3g}", f"{b / np.sqrt(self.periods):.3g}") for j, (a, b) in enumerate(pairs, start=1)
        ]
        return html_table(repr(self), heads, rows)


def average_periods(
    recording: Measurements,
    period: float | None = None,
    harmonics: int | None = None,
    trim: float | tuple[float, float] = 0.0,
) -> PeriodicAverage:
    """Average a periodic recording over its periods, and tell its noise from how far they differ.

    Positions of all periods are fitted by one Fourier series, whose derivatives are exact; torques are averaged row
    by row. What differs from period to period is noise: it shrinks by the square root of their number, and its
    covariance across the joints is known without any model. What returns in each period (friction that the model does
    not have) stays.

    Parameters
    ----------
    recording : Recording
        Two whole periods at least.
    period : float, optional
        s, such as `trajectory.period`; found in the positions without it.
    harmonics : int, optional
        Of the series; without it those that stand out of the noise.
    trim : float or (float, float)
        s left out at both ends: start and stop of the motion.

    Raises
    ------
    InputError
        Where less than two periods are left, or no period is found.

    References
    ----------
    J. Swevers et al., Optimal robot excitation and identification, IEEE Trans. Robotics and Automation 13, 1997.

    Examples
    --------
    >>> from steelyard.recording import Recording
    >>> t = np.arange(8000)[:, None] / 1000.0
    >>> random = np.random.default_rng(1)
    >>> torque = np.cos(2 * np.pi * t / 2.0) + 0.1 * random.normal(size=t.shape)
    >>> average = average_periods(Recording(t=t[:, 0], q=np.sin(2 * np.pi * t / 2.0), torque=torque), period=2.0)
    >>> average.periods, average.samples.count, average.torque_deviation.round(2).tolist()
    (4, 2000, [0.1])
    """
    begin, end = trim if isinstance(trim, tuple) else (trim, trim)
    rate = recording.rate
    start, stop = int(np.ceil(begin * rate - 1e-6)), recording.count - int(np.ceil(end * rate - 1e-6))
    if stop - start < 16:
        raise InputError(f"{recording.source}: trimming leaves {max(stop - start, 0)} rows; shorten `trim`.")
    t, q = recording.t[start:stop], recording.q[start:stop]
    series = FourierFit(period=period, harmonics=harmonics).series(t, q, recording.source)
    torque = recording.torque[start:stop].copy()
    if recording.torque_missing is not None:
        torque[recording.torque_missing[start:stop]] = np.nan
    span = float(t[-1] - t[0]) + 1.0 / rate
    periods = int(span / series.period + 1e-3)
    if periods < 2:
        raise InputError(
            f"{recording.source}: {span:.6g} s hold {periods} whole periods of {series.period:.6g} s; two at least "
            "are needed "
            "for an average."
        )
    rows = round(series.period * rate)
    folded, places = _folded(t, torque, series.period, rate, periods, rows)
    positions, _ = _folded(t, q, series.period, rate, periods, rows)
    known = np.isfinite(folded)
    counts = known.sum(axis=0)
    filled = np.where(known, folded, 0.0)
    mean = filled.sum(axis=0) / np.maximum(counts, 1)
    spread = np.where(known, folded - mean, 0.0)
    shared = np.einsum("psi,psj->ij", known.astype(float), known.astype(float)) * (periods - 1) / periods
    covariance = np.einsum("psi,psj->ij", spread, spread) / np.maximum(shared, 1.0)
    wander = positions - positions.mean(axis=0)
    deviation = np.sqrt(np.sum(wander**2, axis=(0, 1)) / (rows * (periods - 1)))
    motion = series.motion(places)
    noise = ", ".join(f"{value:.3g}" for value in np.sqrt(np.diagonal(covariance)))
    remark = (
        f"{periods} periods of {series.period:.6g} s were averaged, motion as {series.harmonics} harmonics; "
        f"torques differ between the periods by {noise} N·m (standard deviations, by joint)."
    )
    samples = Samples(
        q=motion.q,
        dq=motion.dq,
        ddq=motion.ddq,
        torque=mean,
        mask=None if np.all(counts > 0) else counts > 0,
        t=places,
        remarks=(*recording.remarks, remark),
    )
    return PeriodicAverage(samples, series, periods, deviation, np.sqrt(np.diagonal(covariance)), covariance, folded)


def _folded(t: Array, values: Array, period: float, rate: float, periods: int, rows: int) -> tuple[Array, Array]:
    """Return values (P, S, N) at the same phases of each period, and the times (S,) in the first one."""
    exact = abs(period * rate - rows) * periods < SLIP
    even = np.abs(np.diff(t) * rate - 1.0).max() < SLIP
    if exact and even and periods * rows <= len(t):
        return values[: periods * rows].reshape(periods, rows, -1), t[:rows]
    from scipy.interpolate import CubicSpline

    places = t[0] + np.arange(rows) * (period / rows)
    grid = np.minimum((places + np.arange(periods)[:, None] * period).ravel(), t[-1])
    good = np.isfinite(values)
    columns = []
    for j in range(values.shape[1]):
        own = good[:, j]
        column = CubicSpline(t[own], values[own, j])(grid)
        if not own.all():
            nearest = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
            column[~(own[nearest] & own[nearest - 1])] = np.nan
        columns.append(column)
    return np.column_stack(columns).reshape(periods, rows, -1), places
