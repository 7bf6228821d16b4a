"""Spectrum and autocorrelation of what an answer leaves of the torques."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["autocorrelation", "spectrum"]

Array = NDArray[np.float64]
_SEGMENT = 1024  # rows; longer ones would be told apart in frequency, but be averaged over fewer
_BANDS = 120  # of the spectrum, equally wide on a logarithmic axis
_LAGS = 120


def spectrum(windows: Sequence[Array], interval: float) -> tuple[Array, Array]:
    """Return frequencies (F,) and amplitude densities (F, N), by Welch's method: Hann windows that overlap by half.

    Rows that were not used count as zero, and the density is scaled by the part of the rows that was used.

    Parameters
    ----------
    windows : sequence of (L, N)
        Residuals of neighbouring rows; NaN where a row was not used.
    interval : float
        Between rows, s.

    Examples
    --------
    White noise of 0.5 N·m at 100 Hz has 0.5/√50 N·m/√Hz everywhere:

    >>> noise = np.random.default_rng(0).normal(0.0, 0.5, (8192, 1))
    >>> frequency, density = spectrum([noise], 0.01)
    >>> bool(np.allclose(density[-20:], 0.5 / np.sqrt(50), rtol=0.2)), float(frequency[-1]) < 50.0
    (True, True)
    """
    rows = min(_SEGMENT, max(len(window) for window in windows))
    # Six lines in the place of scipy.signal.welch, with which all of scipy.stats comes: a twelfth of the processor time
    # that `steelyard identify` takes for a short log.
    hann = np.hanning(rows + 1)[:-1, None]
    total: Array | float = 0.0
    used: Array | float = 0.0
    for window in windows:
        if len(window) < rows:
            continue
        known = np.isfinite(window)
        segments = np.lib.stride_tricks.sliding_window_view(np.where(known, window, 0.0), rows, axis=0)
        waves = np.fft.rfft(hann * segments[:: rows - rows // 2].swapaxes(1, 2), axis=1)
        density = 2.0 * interval * np.mean(np.abs(waves) ** 2, axis=0) / np.sum(hann**2)
        total, used = total + density * len(window), used + known.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.asarray(total) / used
    # Neither zero nor the highest frequency, of which a real signal has half.
    frequency, density = np.fft.rfftfreq(rows, interval)[1:-1], density[1:-1]
    edges = np.geomspace(frequency[0], frequency[-1] * (1 + 1e-9), _BANDS + 1)
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, _BANDS - 1)
    first = np.unique(band, return_index=True)[1]
    sizes = np.diff([*first, len(frequency)])
    means = np.add.reduceat(density, first, axis=0) / sizes[:, None]
    return np.add.reduceat(frequency, first) / sizes, np.sqrt(means)


def autocorrelation(windows: Sequence[Array], interval: float) -> tuple[Array, Array, Array]:
    """Return lags (K,) in s, autocorrelations (K, N), and the bound that white noise keeps to in 95 of 100 lags, (N,).

    Pairs of which a row was not used are left out.

    Parameters
    ----------
    windows : sequence of (L, N)
    interval : float

    Examples
    --------
    >>> lag, found, bound = autocorrelation([np.sin(np.arange(400.0))[:, None]], 0.1)
    >>> float(lag[0]), float(found[0, 0]), bool(abs(found[22, 0] - np.cos(22.0)) < 0.05)
    (0.0, 1.0, True)
    """
    longest = max(len(window) for window in windows)
    furthest = min(longest // 2, max(round(2.0 / interval), 50))  # 2 s
    even = np.linspace(0, furthest - 1, min(_LAGS, furthest)).round().astype(int)
    lags = np.unique(np.concatenate([np.arange(min(_LAGS // 4, furthest)), even]))
    stacked = np.concatenate(windows)
    known = np.isfinite(stacked)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, stacked, 0.0).sum(axis=0) / count
    products, pairs = np.zeros((len(lags), stacked.shape[1])), np.zeros((len(lags), stacked.shape[1]))
    for window in windows:
        finite = np.isfinite(window)
        # One joint after the other in memory, so that products are summed without being kept.
        centered, inside = (np.ascontiguousarray(one.T) for one in (np.where(finite, window - mean, 0.0), finite + 0.0))
        for place, lag in enumerate(lags):
            if lag < len(window):
                end = len(window) - lag
                products[place] += np.einsum("js,js->j", centered[:, :end], centered[:, lag:])
                pairs[place] += np.einsum("js,js->j", inside[:, :end], inside[:, lag:])
    with np.errstate(divide="ignore", invalid="ignore"):
        means = products / pairs
        return lags * interval, means / means[0], 1.96 / np.sqrt(count)
