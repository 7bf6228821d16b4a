"""How finely a signal is resolved, and how much noise single values carry."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["noise_deviation", "resolution"]

Array = NDArray[np.float64]
NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def resolution(values: ArrayLike) -> Array:
    """Return the step (N,) of columns (S, N) that are whole multiples of one, such as encoder counts; 0 where none is
    seen.

    Examples
    --------
    >>> t = np.arange(1000) / 1000
    >>> resolution((np.round(np.sin(t) / 1e-3) * 1e-3)[:, None]).round(9).tolist()
    [0.001]
    >>> resolution(np.sin(t)[:, None]).tolist()
    [0.0]
    """
    columns = np.asarray(values, dtype=np.float64)
    steps = np.zeros(columns.shape[1])
    for j, column in enumerate(columns.T):
        size = float(np.abs(column).max(initial=0.0))
        jumps = np.abs(np.diff(column))
        jumps = jumps[jumps > 1e-12 * size]
        if len(jumps) < 8:
            continue
        least = float(np.quantile(jumps, 0.01))
        own = jumps[jumps < 1.5 * least]
        step = float(np.median(own))
        multiple = jumps / step
        small = multiple < 50.0
        off = np.abs(multiple - np.round(multiple))[small]
        if small.sum() >= 8 and np.mean(off < 0.02) > 0.95:
            steps[j] = step
    return steps


def noise_deviation(values: ArrayLike) -> Array:
    """Return the standard deviation (N,) of white noise on smooth columns (S, N), from their fourth differences.

    Motion hardly shows in them; the median absolute value is not moved by single spikes.

    Examples
    --------
    >>> t = np.arange(5000) / 1000
    >>> noise = 0.01 * np.random.default_rng(1).normal(size=t.size)
    >>> noise_deviation((np.sin(t) + noise)[:, None]).round(3).tolist()
    [0.01]
    """
    columns = np.asarray(values, dtype=np.float64)
    if len(columns) < 8:
        return np.zeros(columns.shape[1])
    differences = np.diff(columns, n=4, axis=0)
    # 1, 4, 6, 4, 1 squared and added.
    return np.asarray(NORMAL * np.median(np.abs(differences), axis=0) / np.sqrt(70.0))
