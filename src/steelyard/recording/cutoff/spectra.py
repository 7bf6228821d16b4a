"""Power spectra of the positions: where the motion ends and the noise begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

__all__ = ["Spectra", "motion_spectra"]

Array = NDArray[np.float64]
FEWEST = 64
MOTION_SHARE = 0.99
HIGHEST = 0.4
"""Of the sample rate: what lies above is taken for the work of filters in the drive."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """What `motion_spectra` returns.

    Attributes
    ----------
    frequencies : ndarray
        (F,) Hz, without 0.
    density : ndarray
        (F, N) one-sided power spectral density of the positions, rad²/Hz or m²/Hz.
    crossover : ndarray
        (N,) Hz: above it the spectrum of the acceleration rises again, since noise dominates. NaN for joints at rest.
    noise : ndarray
        (N,) density of the noise just above the crossover.
    """

    frequencies: Array
    density: Array
    crossover: Array
    noise: Array

    @property
    def acceleration(self) -> Array:
        """(F, N) density of the second derivative, ``(2 pi f)^4`` times that of the positions."""
        return np.asarray((2.0 * np.pi * self.frequencies[:, None]) ** 4 * self.density)

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(N,) whether a joint moves."""
        return np.isfinite(self.crossover)


def motion_spectra(q: ArrayLike, rate: float, source: str = "recording") -> Spectra:
    """Estimate the spectra of positions (S, N) by Welch's method, and where noise takes over.

    Motion is resolved by the whole log as one segment, less its linear trend, under a Blackman window, whose side lobes
    fall fast enough to see noise 14 powers of ten below it. The crossover is the minimum of the spectrum of the
    acceleration, smoothed over a sixth of an octave, above the frequencies of the motion (below which lie 99 % of the
    power of the positions) and below 0.4 times the rate. The noise comes from the median of the spectrum up to three
    times the crossover.

    Raises
    ------
    InputError
        For fewer than 64 rows, or where no joint moves.

    References
    ----------
    P. D. Welch, IEEE Trans. Audio and Electroacoustics 15, 1967.
    """
    from scipy.signal import welch

    values = np.asarray(q, dtype=np.float64)
    count, joints = values.shape
    if count < FEWEST:
        raise InputError(
            f"{source} has {count} rows, too few to choose a cutoff by; state `cutoff` in [processing], in Hz."
        )
    ramp = np.linspace(-1.0, 1.0, count)[:, None]
    centred = values - values.mean(axis=0)
    centred = centred - ramp * (ramp * centred).sum(axis=0) / (ramp**2).sum()
    f, density = welch(centred, rate, window="blackman", nperseg=count, axis=0)
    f, density = np.asarray(f[1:], dtype=np.float64), np.maximum(density[1:], 1e-300)
    crossover, noise = np.full(joints, np.nan), np.zeros(joints)
    for j in range(joints):
        if values[:, j].std() < 1e-9:
            continue
        share = np.cumsum(density[:, j]) / density[:, j].sum()
        begin = int(np.argmax(share >= MOTION_SHARE))
        end = int(np.searchsorted(f, HIGHEST * rate))
        smooth = _smoothed(f, np.log((2.0 * np.pi * f) ** 4 * density[:, j]))
        if end - begin < 4:
            continue
        lowest = begin + int(np.argmin(smooth[begin:end]))
        crossover[j] = f[lowest]
        above = (f >= f[lowest]) & (f <= max(min(3.0 * f[lowest], HIGHEST * rate), f[lowest] + 4.0 * f[0]))
        # The median of an exponential distribution, which a periodogram follows, is ln 2 times its mean; single lines
        # of resonances do not move it.
        noise[j] = float(np.median(density[above, j]) / np.log(2.0))
    if not np.isfinite(crossover).any():
        raise InputError(
            f"{source} shows too little motion in its {count} rows to choose a cutoff by; "
            "state `cutoff` in [processing], in Hz."
        )
    return Spectra(f, density, crossover, noise)


def _smoothed(f: Array, values: Array) -> Array:
    """Running mean over a sixth of an octave around each frequency."""
    low = np.searchsorted(f, f * 2.0 ** (-1.0 / 12.0))
    high = np.maximum(np.searchsorted(f, f * 2.0 ** (1.0 / 12.0), side="right"), low + 1)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray((sums[high] - sums[low]) / (high - low))
