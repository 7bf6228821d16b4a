"""What constraints share that depend on the configuration alone, and those on distances between bodies."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.errors import InputError
from steelyard.robot import Robot

from .configurations import LinkPlacements, place_links, random_configurations
from .distances import PairDistances
from .robot_geometry import RobotGeometry

__all__ = ["ConfigurationConstraint", "DistanceConstraint", "check_possible", "checked_margin", "nonnegative"]

Array = NDArray[np.float64]

# Enough for NumPy to be busy, few enough for its arrays to stay in the cache.
SAMPLES_AT_ONCE = 2048

CONFIGURATIONS_TRIED = 500


class ConfigurationConstraint(ABC):
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
        """Return the clearances (S, m), m: at least 0 where the limit is kept, NaN where q is not finite.

        Parameters
        ----------
        q : array_like
            (S, N) configurations, rad or m.
        dq, ddq : array_like, optional
            Not used.
        """
        configurations = self._configurations(q)
        result = np.empty((len(configurations), len(self.labels)))
        for start in range(0, len(configurations), SAMPLES_AT_ONCE):
            part = slice(start, start + SAMPLES_AT_ONCE)
            result[part] = self._values(place_links(self.robot, configurations[part]))
        # No distance is measured where a configuration is no number, which must not pass for a large one.
        result[~np.isfinite(configurations).all(axis=1)] = np.nan
        return result

    def vjp(
        self, q: ArrayLike, dq: ArrayLike | None, ddq: ArrayLike | None, weights: ArrayLike
    ) -> tuple[Array, Array, Array]:
        """Return the gradients (S, N) of ``sum(weights * clearance)`` by q, dq and ddq; the last two are 0.

        Parameters
        ----------
        q : array_like
            (S, N) configurations, rad or m.
        dq, ddq : array_like or None
            Not used.
        weights : array_like
            (S, m).
        """
        configurations = self._configurations(q)
        factors = np.asarray(weights, dtype=np.float64)
        if factors.shape != (len(configurations), len(self.labels)):
            raise InputError(
                f"{self.name}: weights must be of shape {(len(configurations), len(self.labels))}, got {factors.shape}"
            )
        gradient = np.zeros(configurations.shape)
        busy = np.flatnonzero(factors.any(axis=1))
        for start in range(0, len(busy), SAMPLES_AT_ONCE):
            rows = busy[start : start + SAMPLES_AT_ONCE]
            places = place_links(self.robot, configurations[rows])
            forces, moments = self._forces(places, factors[rows])
            gradient[rows] = places.vjp(forces, moments, self.robot.dof)
        return gradient, np.zeros(configurations.shape), np.zeros(configurations.shape)

    def _places(self, q: ArrayLike) -> LinkPlacements:
        return place_links(self.robot, self._configurations(q))

    def _configurations(self, q: ArrayLike) -> Array:
        configurations = np.atleast_2d(np.asarray(q, dtype=np.float64))
        if configurations.ndim != 2 or configurations.shape[1] != self.robot.dof:
            raise InputError(
                f"{self.name}: configurations must be of shape (S, {self.robot.dof}), got shape {np.shape(q)}"
            )
        return configurations

    def __repr__(self) -> str:
        count = len(self.labels)
        return f"{type(self).__name__}({self.name}: {count} clearance{'s' * (count != 1)})"


def nonnegative(value: object, what: str) -> float:
    """Return a length as a float, or raise InputError."""
    number = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number or not (np.isfinite(value) and value >= 0):  # type: ignore[call-overload, operator]
        raise InputError(f"{what} must be 0 or more, in m, got {value!r}")
    return float(value)  # type: ignore[arg-type]


def check_possible(constraint: ConfigurationConstraint, remedy: str) -> None:
    """Raise InputError where a clearance is negative at each of many random configurations."""
    best = constraint.clearance(random_configurations(constraint.robot, CONFIGURATIONS_TRIED)).max(
        axis=0, initial=-np.inf
    )
    for label, value in zip(constraint.labels, best, strict=True):
        if value < 0:
            raise InputError(
                f"{constraint.name}: {label} is violated by {-value:.3g} m or more at each of {CONFIGURATIONS_TRIED} "
                "random "
                f"configurations within the limits of the joints; {remedy}"
            )


# The common part of constraints on distances between bodies.

# m beyond the margin; what is farther away does not matter to a motion.
DEFAULT_REACH = 0.1


class DistanceConstraint(ConfigurationConstraint):
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
            (S, N) configurations, rad or m.
        """
        configurations = self._configurations(q)
        result = self._pairs.distances(self._places(configurations), np.inf)
        result[~np.isfinite(configurations).all(axis=1)] = np.nan
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
