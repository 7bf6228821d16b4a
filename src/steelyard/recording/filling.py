"""Values that a log does not hold, filled so that filters can go on, and marked so that nobody uses them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import InputError

__all__ = ["filled"]

Array = NDArray[np.float64]


def filled(t: Array, values: Array | None, what: str, source: str) -> tuple[Array | None, NDArray[np.bool_] | None]:
    """Replace NaN in columns (S, N) by monotone cubic interpolation over t (S,), at the ends by the nearest value.

    Returns
    -------
    values : ndarray or None
    missing : ndarray of bool or None
        (S, N) where values were NaN; None where none was.

    Raises
    ------
    InputError
        Where a column has fewer than two numbers.
    """
    if values is None:
        return None, None
    missing = np.isnan(values)
    if not missing.any():
        return values, None
    from scipy.interpolate import PchipInterpolator

    result = values.copy()
    for j in map(int, np.flatnonzero(missing.any(axis=0))):
        good = ~missing[:, j]
        if np.count_nonzero(good) < 2:
            raise InputError(
                f"{source}: the {what} of joint {j + 1} has {np.count_nonzero(good)} numbers in {len(t)} rows, too "
                "few to fill "
                "the others."
            )
        inside = np.clip(t, t[good][0], t[good][-1])
        result[~good, j] = PchipInterpolator(t[good], values[good, j])(inside[~good])
    return result, missing
