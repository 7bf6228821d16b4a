"""What constraints share that depend on the configuration alone, and those on distances between bodies."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.robot import Robot

from .configurations import LinkPlacements, place_links, random_postures
from .distances import PairDistances
from .robot_geometry import RobotGeometry

__all__ = ["DistanceConstraint", "PostureConstraint", "check_possible", "checked_margin", "nonnegative"]

Array = NDArray[np.float64]

# Enough for NumPy to be busy, few enough for its arrays to stay in the cache.
SAMPLES_AT_ONCE = 2048

POSTURES_TRIED = 500


class PostureConstraint(ABC):
    """A :class:`~steelyard.excitation.motion_constraints.MotionConstraint` on where the links are.

    Attributes
    ----------
    robot : Robot
    name : str
        For messages.
    labels : tuple of str
        (m,) what each column is.
    scale : float
        m, what counts as one unit of violation.
    """

    robot: Robot
    name: str
    labels: tuple[str, ...]
    scale: float = 0.1

    @abstractmethod
    def _values(self, places: LinkPlacements) -> Array:
        """Return the clearances (S, m)."""

    @abstractmethod
    def _forces(self, places: LinkPlacements, weights: Array) -> tuple[Array, Array]:
        """Return forces and moments on the links, (B + 1, S, 3) each, whose work is that of sum(weights * values)."""

    def clearance(self, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None) -> Array:
        """Return the clearances (S, m), m: at least 0 where the limit is kept, NaN at postures that are not finite.

        Parameters
        ----------
        q : array_like
            (S, N) postures, rad or m.
        dq, ddq : array_like, optional
            Not used.
        """
        postures = self._postures(q)
        result = np.empty((len(postures), len(self.labels)))
        for start in range(0, len(postures), SAMPLES_AT_ONCE):
            part = slice(start, start + SAMPLES_AT_ONCE)
            result[part] = self._values(place_links(self.robot, postures[part]))
        # No distance is measured where a posture is no number, which must not pass for a large one.
        result[~np.isfinite(postures).all(axis=1)] = np.nan
        return result

    def pull_back(
        self, q: ArrayLike, dq: ArrayLike | None, ddq: ArrayLike | None, weights: ArrayLike
    ) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)`` by q, dq and ddq; the last two are 0.

        Parameters
        ----------
        q : array_like
            (S, N) postures, rad or m.
        dq, ddq : array_like or None
            Not used.
        weights : array_like
            (S, m).
        """
        postures = self._postures(q)
        factors = np.asarray(weights, dtype=np.float64)
        if factors.shape != (len(postures), len(self.labels)):
            raise InputError(
                f"{self.name}: weights must be of shape {(len(postures), len(self.labels))}, got {factors.shape}"
            )
        gradient = np.zeros(postures.shape)
        busy = np.flatnonzero(factors.any(axis=1))
        for start in range(0, len(busy), SAMPLES_AT_ONCE):
            rows = busy[start : start + SAMPLES_AT_ONCE]
            places = place_links(self.robot, postures[rows])
            forces, moments = self._forces(places, factors[rows])
            gradient[rows] = places.pull_back(forces, moments, self.robot.dof)
        return gradient, np.zeros(postures.shape), np.zeros(postures.shape)

    def _places(self, q: ArrayLike) -> LinkPlacements:
        return place_links(self.robot, self._postures(q))

    def _postures(self, q: ArrayLike) -> Array:
        postures = np.atleast_2d(np.asarray(q, dtype=np.float64))
        if postures.ndim != 2 or postures.shape[1] != self.robot.dof:
            raise InputError(f"{self.name}: postures must be of shape (S, {self.robot.dof}), got shape {np.shape(q)}")
        return postures

    def __repr__(self) -> str:
        count = len(self.labels)
        return f"{type(self).__name__}({self.name}: {count} clearance{'s' * (count != 1)})"


def nonnegative(value: object, what: str) -> float:
    """Return a length as a float, or raise InputError."""
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number or not (np.isfinite(value) and value >= 0):  # type: ignore[call-overload, operator]
        raise InputError(f"{what} must be 0 or more, in m, got {value!r}")
    return float(value)  # type: ignore[arg-type]


def check_possible(constraint: PostureConstraint, remedy: str) -> None:
    """Raise InputError where a clearance is negative at each of many random postures."""
    best = constraint.clearance(random_postures(constraint.robot, POSTURES_TRIED)).max(axis=0, initial=-np.inf)
    for label, value in zip(constraint.labels, best, strict=True):
        if value < 0:
            raise InputError(
                f"{constraint.name}: {label} is violated by {-value:.3g} m or more at each of {POSTURES_TRIED} random "
                f"postures within the limits of the joints; {remedy}"
            )


# The common part of constraints on distances between bodies.

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
