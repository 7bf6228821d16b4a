"""Robots whose torques are in another unit than those of the others, where they are so many that no unit is usual."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["OtherUnit", "other_unit"]

Array = NDArray[np.float64]

DETERMINED = 5.0
"""Standard deviations that a base parameter of each robot has at least, by whose size scales are told."""
FEWEST = 3
"""Such parameters, of which most must be larger by one factor."""
LEAST = np.log(20.0)
"""Logarithm of the factor from which on nothing but a unit makes all torques larger: sensors and constants of motors
are off by percents, and robots of one description by less than this."""
ALIKE = 0.25
"""How far robots of one unit are from each other at most, as a part of how far the two units are apart."""
UNITS = {1000.0: ("mN·m", "N·m"), 100.0: ("N·cm", "N·m")}
NEAR = 0.05


class OtherUnit(NamedTuple):
    """Robots whose torques are larger.

    Attributes
    ----------
    robots : ndarray of int
        Their numbers.
    factor : float
        By how much, in the median of their parameters.
    """

    robots: NDArray[np.intp]
    factor: float

    @property
    def units(self) -> tuple[str, str] | None:
        """What they, and the others, may be in."""
        return next((told for times, told in UNITS.items() if abs(self.factor / times - 1.0) < NEAR), None)


def other_unit(bases: Array, covariances: Array) -> OtherUnit | None:
    """Return which robots, half of all or more, have the same parameters in a unit that is much smaller.

    Where they are fewer, what is usual is in the unit of the others, and they are told by their torques. Half of twelve
    robots in mN·m varied by as much as from N·m to mN·m, and none differed.

    Parameters
    ----------
    bases, covariances : (R, n_b), (R, n_b, n_b)

    Examples
    --------
    >>> usual = np.array([4.0, -2.0, 0.5, 1.0])
    >>> bases = np.array([usual, 1.1 * usual, 1050.0 * usual, 980.0 * usual])
    >>> found = other_unit(bases, bases[:, :, None] ** 2 * np.eye(4) / 100.0)
    >>> found.robots.tolist(), found.units
    ([2, 3], ('mN·m', 'N·m'))
    >>> other_unit(bases[:3], bases[:3, :, None] ** 2 * np.eye(4) / 100.0) is None
    True
    """
    sizes = np.abs(bases)
    determined = np.all(sizes > DETERMINED * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)), axis=0)
    if len(bases) < 2 or np.sum(determined) < FEWEST:
        return None
    logs = np.log(sizes[:, determined])
    scales = np.median(logs - np.median(logs, axis=0), axis=1)
    order = np.argsort(scales, kind="stable")
    gaps = np.diff(scales[order])
    first = int(np.argmax(gaps)) + 1
    low, high = order[:first], np.sort(order[first:])
    apart = logs[high].mean(axis=0) - logs[low].mean(axis=0)
    factor = float(np.median(apart))
    spread = max(float(np.ptp(scales[own])) for own in (low, high))
    one_factor = float(np.median(np.abs(apart - factor)))
    if factor < LEAST or max(spread, one_factor) > ALIKE * factor or 2 * len(high) < len(bases):
        return None
    return OtherUnit(high, float(np.exp(factor)))
