"""The common part of constraints on distances between bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError

from .distances import PairDistances
from .placements import LinkPlacements
from .posture_constraint import PostureConstraint, nonnegative
from .robot_geometry import RobotGeometry

__all__ = ["DistanceConstraint", "checked_margin"]

Array = NDArray[np.float64]

# m beyond the margin; what is farther away does not matter to a motion.
DEFAULT_REACH = 0.1


class DistanceConstraint(PostureConstraint):
    """Distances between bodies that must not be below a margin.

    Attributes
    ----------
    margin : float
        Least distance, m.
    margins : ndarray
        (m,) least distance of each clearance, m; below `margin` where that can never be kept.
    horizon : float
        m; larger distances count as this one, so that pairs far apart need not be computed. The clearance is
        ``min(distance, horizon) - margin``, its gradient 0 beyond the horizon.
    """

    margin: float
    margins: Array
    horizon: float

    def __init__(
        self,
        geometry: RobotGeometry,
        pairs: PairDistances,
        labels: tuple[str, ...],
        margins: Array,
        margin: float,
        horizon: float | None,
    ) -> None:
        self.robot = geometry.robot
        self.geometry = geometry
        self.labels = labels
        self.margin = margin
        self.margins = margins
        self.horizon = margin + DEFAULT_REACH if horizon is None else nonnegative(horizon, f"{self.name}: the horizon")
        if self.horizon <= margin:
            raise InputError(
                f"{self.name}: the horizon must be larger than the margin of {margin:g} m, got {self.horizon:g} m"
            )
        self._pairs = pairs

    def distances(self, q: ArrayLike) -> Array:
        """Return the signed distances (S, m), m, without horizon; negative values are depths of penetration.

        Parameters
        ----------
        q : array_like
            (S, N) postures, rad or m.
        """
        postures = self._postures(q)
        result = self._pairs.distances(self._places(postures), np.inf)
        result[~np.isfinite(postures).all(axis=1)] = np.nan
        return result

    def _values(self, places: LinkPlacements) -> Array:
        return self._pairs.distances(places, self.horizon) - self.margins

    def _forces(self, places: LinkPlacements, weights: Array) -> tuple[Array, Array]:
        forces, moments = (np.zeros_like(places.positions) for _ in range(2))
        for group, found in enumerate(self._pairs.nearest(places, weights != 0, self.horizon)):
            pushes = weights[found.rows, group, None] * found.normal
            first, second = self._pairs.bodies(group)
            for body, points, sign in ((first, found.first, -1.0), (second, found.second, 1.0)):
                forces[body, found.rows] += sign * pushes
                moments[body, found.rows] += sign * np.cross(points, pushes)
        return forces, moments


def checked_margin(margin: object, what: str) -> float:
    """Return a margin as a float, or raise InputError."""
    return nonnegative(margin, f"{what}: the margin")
