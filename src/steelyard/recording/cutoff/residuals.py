"""Residual analysis: what filters of different cutoffs take away from the positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..filtering import low_pass

__all__ = ["ResidualAnalysis", "residual_analysis"]

Array = NDArray[np.float64]
STRAIGHT = 0.5
"""The line is laid through the residuals at the cutoffs above this fraction of the highest."""


@dataclass(frozen=True, eq=False)
class ResidualAnalysis:
    """What `residual_analysis` returns.

    Attributes
    ----------
    cutoffs : ndarray
        (C,) Hz, that were tried.
    residuals : ndarray
        (C, N) root mean square of what the filter took away, rad or m.
    noise : ndarray
        (N,) where the straight line through the residuals at high cutoffs meets 0 Hz.
    chosen : ndarray
        (N,) Hz: the lowest cutoff whose residual is that noise.
    """

    cutoffs: Array
    residuals: Array
    noise: Array
    chosen: Array


def residual_analysis(
    q: ArrayLike, rate: float, cutoffs: ArrayLike, order: int = 3, source: str = ""
) -> ResidualAnalysis:
    """Filter positions (S, N) with each cutoff (C,) in Hz and see what is left over (Winter 2009, section 2.2.4.5).

    At high cutoffs the filter takes away noise alone, in nearly linear relation to the cutoff. The line, drawn on to
    0 Hz, tells the noise on the whole, and the cutoff that takes away as much is the one at which distortion and
    remaining noise are about even, in the position; accelerations ask for less noise.

    References
    ----------
    D. A. Winter, Biomechanics and Motor Control of Human Movement, 4th ed., Wiley, 2009.
    """
    values, tried = np.asarray(q, dtype=np.float64), np.asarray(cutoffs, dtype=np.float64)
    residuals = np.array(
        [np.sqrt(np.mean((values - low_pass(values, rate, float(f), order, source)) ** 2, axis=0)) for f in tried]
    )
    high = tried >= STRAIGHT * tried[-1]
    noise = np.maximum(np.polyfit(tried[high], residuals[high], 1)[1], 0.0)
    chosen = np.array([_crossing(tried, residuals[:, j], noise[j]) for j in range(values.shape[1])])
    return ResidualAnalysis(tried, residuals, noise, chosen)


def _crossing(cutoffs: Array, residuals: Array, level: float) -> float:
    """The lowest cutoff at which the residual has fallen to the level, interpolated in the logarithm."""
    below = np.flatnonzero(residuals <= level)
    if not len(below):
        return float(cutoffs[-1])
    k = int(below[0])
    if k == 0 or residuals[k - 1] <= residuals[k]:
        return float(cutoffs[k])
    part = (residuals[k - 1] - level) / (residuals[k - 1] - residuals[k])
    return float(cutoffs[k - 1] * (cutoffs[k] / cutoffs[k - 1]) ** part)
