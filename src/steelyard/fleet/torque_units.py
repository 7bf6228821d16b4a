"""Robots whose torques are in another unit than those of the others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["OtherUnit", "other_units"]

Array = NDArray[np.float64]

DETERMINED = 5.0
"""Standard deviations that a base parameter of each robot has at least, by whose size scales are told."""
FEWEST = 3
"""Such parameters, of which most must be larger by one factor."""
LEAST = np.log(4.0)
"""Logarithm of the factor from which on nothing but a unit makes all torques larger: sensors and constants of motors
are off by percents, and robots of one description by less than this. With 20, nothing was said of half of eight robots
in lb·in, and of three of them what was 8.9 times as large and what was not differed in a dozen other parts."""
ALIKE = 0.25
"""How far robots of one unit are from each other at most, as a part of how far the two units are apart."""
UNITS = {1000.0: ("mN·m", "N·m"), 100.0: ("N·cm", "N·m")}
NEAR = 0.05


class OtherUnit(NamedTuple):
    """Robots whose torques are larger or smaller than those of most.

    Attributes
    ----------
    robots : ndarray of int
        Their numbers.
    factor : float
        How many times those of most they are, in the median of their parameters.
    """

    robots: NDArray[np.intp]
    factor: float

    @property
    def units(self) -> tuple[str, str] | None:
        """What they, and the others, may be in."""
        larger = max(self.factor, 1.0 / self.factor)
        found = next((told for times, told in UNITS.items() if abs(larger / times - 1.0) < NEAR), None)
        return found if found is None or self.factor > 1.0 else found[::-1]


def other_units(bases: Array, covariances: Array) -> list[OtherUnit]:
    """Return which robots have the same parameters as most, or as many with smaller ones, in another unit.

    Compared all the same, half of twelve robots in mN·m varied by as much as from N·m to mN·m, and none differed; with
    three of eight, there were eight batches.

    Parameters
    ----------
    bases, covariances : (R, n_b), (R, n_b, n_b)

    Examples
    --------
    >>> usual = np.array([4.0, -2.0, 0.5, 1.0])
    >>> bases = np.array([usual, 1.1 * usual, 1050.0 * usual, 980.0 * usual])
    >>> [found] = other_units(bases, bases[:, :, None] ** 2 * np.eye(4) / 100.0)
    >>> found.robots.tolist(), found.units
    ([2, 3], ('mN·m', 'N·m'))
    >>> other_units(bases[:2], bases[:2, :, None] ** 2 * np.eye(4) / 100.0)
    []
    """
    sizes = np.abs(bases)
    determined = np.all(sizes > DETERMINED * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)), axis=0)
    if np.sum(determined) < FEWEST:
        return []
    logs = np.log(sizes[:, determined])
    scales = np.median(logs - np.median(logs, axis=0), axis=1)
    order = np.argsort(scales, kind="stable")
    heaps = np.split(order, 1 + np.flatnonzero(np.diff(scales[order]) > LEAST))
    usual = max(heaps, key=len)
    found = []
    for robots in heaps:
        apart = logs[robots].mean(axis=0) - logs[usual].mean(axis=0)
        factor = float(np.median(apart))
        within = max(np.ptp(scales[robots]), np.ptp(scales[usual]), np.median(np.abs(apart - factor)))
        if robots is not usual and within < ALIKE * abs(factor):
            found.append(OtherUnit(np.sort(robots), float(np.exp(factor))))
    return found
