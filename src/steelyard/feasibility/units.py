"""Units of mass and length for each link, in which parameters and blocks are about 1."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.once import cached_property

from .feasible_set import FeasibleSet

__all__ = ["Units", "sizes_of_bodies"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

POWERS = np.array([2.0] * 6 + [1.0] * 3 + [0.0])
"""Powers of length in the units of the inertial parameters of a link, in their order."""

LENGTH = 0.3
"""Length of a link, in m, if the model does not tell it. With 0.03 and with 3 the optima of 100 random fits are found
as well."""

SHORTEST, LONGEST = 0.1, 10.0
"""Smallest and largest length of a link relative to the typical length: radii of gyration in descriptions may be
wrong."""

SPREAD = 1e3
"""Largest factor by which the unit of a link's mass may be below the median one. With 1e6 one of 100 random fits is not
solved (gap of 2e-5), since a link may be nearly massless in the point from which units are taken; 10 serves as well."""


LEAST_RADIUS = 0.01
"""Smallest radius, in m, by which sizes of a body are told. A description may make a link a point, whose sizes would be
zero: its moments could not move at all."""


def typical_length(feasible_set: FeasibleSet) -> float:
    """Typical distance between joints in m, from the coefficients of masses in the base parameters of first moments."""
    columns = feasible_set.link_columns
    independent = np.asarray(feasible_set.model.base_parameters().independent, dtype=np.intp)
    rows = np.isin(independent, columns[:, 6:9])
    factors = np.abs(feasible_set.K[np.ix_(rows, columns[:, 9])])
    factors = factors[factors > 1e-6]
    return float(np.exp(np.mean(np.log(factors)))) if len(factors) else LENGTH


def lengths_of_links(inertial: Matrix, least: float, most: float = np.inf) -> Vector:
    """Radii of gyration about the origins of the links' frames, within bounds, from (links, 10), in m."""
    trace = np.maximum(inertial[:, 0] + inertial[:, 3] + inertial[:, 5], 0.0)
    return np.asarray(np.clip(np.sqrt(trace / (2 * inertial[:, 9])), least, most))


def sizes_of_bodies(inertial: Matrix) -> Matrix:
    """The sizes of inertial parameters (links, 10), by the mass and the radius of each body, (links, 10)."""
    return np.asarray(inertial[:, 9:] * lengths_of_links(inertial, LEAST_RADIUS)[:, None] ** POWERS)


@dataclass(frozen=True, eq=False)
class Units:
    """Typical sizes of the standard parameters.

    Attributes
    ----------
    feasible_set : FeasibleSet
    masses : (links,)
        In kg.
    lengths : (links,)
        In m.
    term : float or (others,)
        Units of the other parameters in SI: one for all, or one for each.
    """

    feasible_set: FeasibleSet = field(repr=False)
    masses: Vector
    lengths: Vector
    term: float | Vector

    @cached_property
    def parameters(self) -> Vector:
        """One unit for each standard parameter, (n,)."""
        units = np.empty(self.feasible_set.parameter_count)
        units[_others(self.feasible_set)] = self.term
        units[self.feasible_set.link_columns] = self.inertial
        return units

    @property
    def inertial(self) -> Matrix:
        """One unit for each inertial parameter, (links, 10)."""
        return np.asarray(self.masses[:, None] * self.lengths[:, None] ** POWERS)

    @cached_property
    def total_mass(self) -> float:
        """Sum of the units of mass of all links, in kg."""
        return float(self.masses.sum())

    @classmethod
    def of(cls, feasible_set: FeasibleSet) -> "Units":
        """Units without data: those of the description, or 1 kg and the typical length."""
        return cls.from_sizes(feasible_set, np.full(feasible_set.parameter_count, np.inf)).with_cad()

    @classmethod
    def from_sizes(cls, feasible_set: FeasibleSet, sizes: Vector) -> "Units":
        """Units with the same mass and length for all links, from the size of the torques.

        Parameters
        ----------
        feasible_set : FeasibleSet
        sizes : (n,)
            The value of each parameter that alone would explain all torques; infinite where none does.
        """
        columns = feasible_set.link_columns
        length = feasible_set.kept(typical_length)
        inertial = sizes[columns]
        middles = [_middle(inertial[:, power == POWERS]) / length**power for power in (0.0, 1.0, 2.0)]
        masses = [mass for mass in middles if np.isfinite(mass)]
        term = _middle(sizes[_others(feasible_set)])
        count = len(columns)
        return cls(
            feasible_set,
            np.full(count, min(masses, default=1.0)),
            np.full(count, length),
            term if np.isfinite(term) else 1.0,
        )

    def with_cad(self) -> "Units":
        """The masses and lengths of the description if it has a positive mass for every link, otherwise these units."""
        values = np.asarray(self.feasible_set.model.robot.parameters, dtype=float)
        inertial = values[self.feasible_set.link_columns]
        if not (np.all(np.isfinite(inertial)) and np.all(inertial[:, 9] > 0)):
            return self
        return self._of(inertial.copy())

    def refined(self, parameters: Vector) -> "Units":
        """These units, reduced for links that are smaller in a point that a solver found."""
        inertial = parameters[self.feasible_set.link_columns].copy()
        positive = inertial[inertial[:, 9] > 0, 9]
        if not len(positive):
            return self
        inertial[:, 9] = np.maximum(inertial[:, 9], _middle(positive) / SPREAD)
        found = self._of(inertial)
        return Units(
            self.feasible_set,
            np.minimum(self.masses, found.masses),
            np.minimum(self.lengths, found.lengths),
            self.term,
        )

    def around(self, parameters: Vector) -> "Units":
        """Units of the links and terms in a point that a solver found, which may be smaller or larger than these."""
        inertial = parameters[self.feasible_set.link_columns].copy()
        inertial[:, 9] = np.maximum(inertial[:, 9], self.masses / SPREAD)
        typical = self.feasible_set.kept(typical_length)
        lengths = lengths_of_links(inertial, typical / SPREAD, typical * SPREAD)
        terms = np.maximum(np.abs(parameters[_others(self.feasible_set)]), np.asarray(self.term) / SPREAD)
        return Units(self.feasible_set, inertial[:, 9], lengths, terms)

    def _of(self, inertial: Matrix) -> "Units":
        typical = self.feasible_set.kept(typical_length)
        lengths = lengths_of_links(inertial, SHORTEST * typical, LONGEST * typical)
        return Units(self.feasible_set, inertial[:, 9], lengths, self.term)


def _others(feasible_set: FeasibleSet) -> npt.NDArray[np.bool_]:
    """Return which parameters belong to no link, (n,)."""
    found = np.ones(feasible_set.parameter_count, dtype=bool)
    found[feasible_set.link_columns] = False
    return found


def _middle(values: Matrix) -> float:
    """The median of the finite positive values; infinite if there are none."""
    good = np.sort(values[np.isfinite(values) & (values > 0)])
    return float(good[len(good) // 2]) if good.size else np.inf
