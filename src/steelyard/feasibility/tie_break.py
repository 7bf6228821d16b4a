"""Tie-breaks: objectives over the standard parameters that choose one of many equally good answers."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import InputError
from steelyard.regression.factor import eigenvectors

from .cone_program import Part, Program, unidentifiable_conditions
from .feasible_set import FeasibleSet
from .units import Units, sizes_of_bodies

__all__ = ["TieBreak", "closest_to_cad", "lightest", "lightest_parameters"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

SPREAD_WEIGHT = 1e-3
"""Weight of the traces of the blocks (moments in kg m², friction) relative to the total mass in kg. It makes the
lightest answer compact. With 1e-6 the solver needs 30 % more iterations on 100 random fits and finds fewer choices
exactly; with 0.1 it needs 20 % fewer, but then mass is traded for moments."""

FREE_WEIGHT = 1e-6
"""Weight of the squares of all parameters, which makes those unique that neither data nor conditions determine."""


@dataclass(frozen=True, eq=False)
class TieBreak:
    """A named objective ½ δᵀC δ + g · δ over the standard parameters.

    Attributes
    ----------
    name : str
        Completes the sentence "Among all answers this is ...", such as ``"the lightest"``.
    curvature : (n,) or (n, n)
        C, or its diagonal; positive semidefinite.
    gradient : (n,)

    Examples
    --------
    The answer closest to given parameters in a given metric, to be handed to ``fit(..., prefer=...)``:

    >>> prefer = TieBreak.closest([1.0, 2.0], [[2.0, 0.0], [0.0, 8.0]])
    >>> prefer.value(np.array([1.0, 3.0])) - prefer.value(np.array([1.0, 2.0]))
    4.0
    """

    name: str
    curvature: Any = field(repr=False)
    gradient: Vector = field(repr=False)

    @classmethod
    def closest(cls, parameters: npt.ArrayLike, metric: npt.ArrayLike, name: str = "the closest") -> "TieBreak":
        """The tie-break ½ (δ - δ₀)ᵀ C (δ - δ₀), up to a constant.

        Parameters
        ----------
        parameters : (n,)
            δ₀.
        metric : (n,) or (n, n)
            C, or its diagonal, such as the inverse of the covariance of δ₀.
        name : str
            Completes the sentence "Among all answers this is ...".

        Raises
        ------
        InputError
            If the sizes do not fit, or the metric is not symmetric and positive semidefinite.
        """
        point, curvature = np.asarray(parameters, dtype=float), np.asarray(metric, dtype=float)
        if point.ndim != 1 or curvature.shape not in (point.shape, point.shape * 2):
            raise InputError(
                f"a tie-break needs parameters (n,) and a metric (n,) or (n, n), got shapes {point.shape} and "
                f"{curvature.shape}."
            )
        if not (np.all(np.isfinite(point)) and np.all(np.isfinite(curvature))):
            raise InputError("a tie-break needs finite parameters and a finite metric; replace what is not a number.")
        _require_semidefinite(curvature)
        return cls(name, curvature, -(curvature * point if curvature.ndim == 1 else curvature @ point))

    def value(self, parameters: Vector) -> float:
        """Value of the objective at δ, without the constant ½ δ₀ᵀC δ₀."""
        return float((0.5 * self._times(parameters) + self.gradient) @ parameters)

    def alone(self, index: int, parameters: Vector) -> float:
        """The preferred value of one parameter for given others: maybe infinite, and 0 if all values are equal."""
        row = self.curvature[index]
        own = float(row if np.ndim(row) == 0 else row[index])
        slope = float(self._times(parameters)[index] + self.gradient[index]) - own * float(parameters[index])
        if own == 0.0:
            return 0.0 if slope == 0.0 else -np.sign(slope) * np.inf
        return -slope / own

    def _times(self, parameters: Vector) -> Vector:
        diagonal = getattr(self.curvature, "ndim", 2) == 1
        return np.asarray(self.curvature * parameters if diagonal else self.curvature @ parameters)

    def check(self, count: int) -> None:
        """Raise InputError unless the tie-break is about n parameters."""
        if np.shape(self.gradient) != (count,) or np.shape(self.curvature) not in ((count,), (count, count)):
            raise InputError(
                f"the tie-break {self.name!r} is of {np.size(self.gradient)} parameters, but the model has {count}."
            )

    def slope(self, parameters: Vector) -> Vector:
        """Gradient of the objective at δ, (n,)."""
        return self._times(parameters) + self.gradient

    @property
    def entropy(self) -> float:
        """Factor of the term -Σ log det P in the objective, which is always zero here."""
        return 0.0

    def root(self) -> Matrix:
        """G with GᵀG = ½ C, (r, n)."""
        if np.ndim(self.curvature) == 1:
            used = np.flatnonzero(self.curvature)
            found = np.zeros((len(used), len(self.curvature)))
            found[np.arange(len(used)), used] = np.sqrt(0.5 * self.curvature[used])
            return found
        values, vectors = eigenvectors(self.curvature)
        return np.asarray(np.sqrt(0.5 * np.maximum(values, 0.0))[:, None] * vectors.T)

    def size(self, parameters: Vector) -> float:
        """Unit in which gaps of the objective are told: the sum of the sizes of its terms at δ, or 1."""
        return float(0.5 * parameters @ self._times(parameters) + np.abs(self.gradient) @ np.abs(parameters)) or 1.0

    def part(self, program: Program) -> Part:
        """The tie-break as a part of the objective of a program, up to a constant."""
        matrix = sparse.csc_array(program.scaled_matrix)
        if getattr(self.curvature, "ndim", 2) == 1:
            P = matrix.T @ matrix.multiply(self.curvature[:, None])
        else:
            P = matrix.T @ (sparse.csc_array(self.curvature) @ matrix)
        P = sparse.csc_array(sparse.triu(P, format="csc"))
        return Part(P, np.asarray(matrix.T @ (self.gradient + self._times(program.origin))))


def _require_semidefinite(curvature: Matrix) -> None:
    if curvature.ndim == 1:
        least, symmetric = float(curvature.min(initial=0.0)), True
    else:
        symmetric = bool(np.allclose(curvature, curvature.T, rtol=1e-9, atol=0.0))
        least = float(np.linalg.eigvalsh(curvature)[0]) if symmetric and len(curvature) else 0.0
    if not symmetric or least < -1e-9 * float(np.abs(curvature).max(initial=0.0)):
        raise InputError(
            "the metric of a tie-break must be symmetric and positive semidefinite; give the inverse of a covariance."
        )


def lightest(feasible_set: FeasibleSet, units: Units | None = None) -> TieBreak:
    """The tie-break for the least total mass; among equals for small moments and friction, then for small parameters.

    Parameters
    ----------
    feasible_set : FeasibleSet
    units : Units, optional
        Units of the squares of the parameters; SI by default.
    """
    gradient = SPREAD_WEIGHT * feasible_set.trace_row
    gradient[feasible_set.mass_indices] = 1.0
    sizes = np.ones(feasible_set.parameter_count) if units is None else units.parameters
    total = 1.0 if units is None else units.total_mass
    return TieBreak("the lightest", FREE_WEIGHT * total / sizes**2, gradient)


def lightest_parameters(feasible_set: FeasibleSet, base: Vector, margin: float) -> Vector | None:
    """The lightest parameters with given base parameters, or None where the solver does not reach them.

    Parameters
    ----------
    base : (n_b,)
        β; K δ = β.
    margin : float
        The blocks keep this distance from the boundary, in SI or, for small links, in their own units.

    Returns
    -------
    (n,) or None
        As the solver left them: whether the set contains them is for the caller to check.
    """
    conditions = feasible_set.kept(unidentifiable_conditions)
    units = Units.of(feasible_set).parameters
    program = Program.along(feasible_set, conditions, units, feasible_set.lift @ base, margin)
    solution = program.solve(lightest(feasible_set).part(program))
    return program.parameters(solution.primal) if solution.usable else None


def closest_to_cad(feasible_set: FeasibleSet) -> TieBreak:
    """The tie-break for the least squared distance from the inertial parameters of CAD, in units of each link.

    The mass counts in units of the CAD mass m, first moments in m r, moments of inertia in m r², where r is the largest
    of the link's radius of gyration about its frame's origin and 1 cm.

    Raises
    ------
    InputError
        If the robot's description has no inertial parameters.
    """
    cad = np.asarray(feasible_set.model.robot.parameters, dtype=float)
    columns = feasible_set.link_columns
    known = np.all(np.isfinite(cad[columns]), axis=1) & (cad[columns[:, 9]] > 0)
    if not np.any(known):
        raise InputError(
            'prefer="cad" needs inertial parameters in the robot description, which has none; use prefer="lightest".'
        )
    curvature = np.full(feasible_set.parameter_count, FREE_WEIGHT)
    gradient = np.zeros(feasible_set.parameter_count)
    values = cad[columns[known]]
    sizes = sizes_of_bodies(values)
    curvature[columns[known]] = 2.0 / sizes**2
    gradient[columns[known]] = -2.0 / sizes**2 * values
    return TieBreak("the closest to CAD", curvature, gradient)
