"""Priors: what is known about the parameters before any motion, as a distance from given parameters."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sparse

from steelyard.conic import Cone, Rows, stacked_triangle
from steelyard.errors import InputError
from steelyard.feasibility.barrier import add_log_determinants, log_determinants
from steelyard.feasibility.cone_program import Part, Program
from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.feasibility.units import sizes_of_bodies
from steelyard.once import cached_property
from steelyard.robot.inertia import PSEUDO_INERTIA, pseudo_inertia

__all__ = ["ConstantPullbackPrior", "EntropicPrior", "EuclideanPrior", "PreparedPrior", "Prior", "distance_from"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

SINGULAR = 1e-9
"""A pseudo-inertia whose smallest eigenvalue is below this, after its diagonal is scaled to 1, cannot serve as a
metric: its inverse would hold rounding errors alone."""


@dataclass(frozen=True, eq=False)
class Prior(ABC):
    """Base class of priors; see `EuclideanPrior`, `EntropicPrior` and `ConstantPullbackPrior`.

    Parameters
    ----------
    parameters : (n,), optional
        δ₀; those of the robot's description (CAD) by default. NaN for terms (friction, rotor inertia) that are unknown.
    term_deviations : (n,), optional
        Standard deviations s of the unknown terms about zero: ½ (δ / s)² is added once, whatever the weight of the
        prior. Infinite by default, so that nothing is said of them. The entries of links are not read.
    """

    parameters: npt.ArrayLike | None = field(default=None, repr=False)
    term_deviations: npt.ArrayLike | None = field(default=None, repr=False, kw_only=True)

    label: ClassVar[str] = ""
    needs_density: ClassVar[bool] = True

    def prepare(self, feasible_set: FeasibleSet, weight: float = 1.0) -> "PreparedPrior":
        """Check the prior against a model, and compute its metric.

        Parameters
        ----------
        feasible_set : FeasibleSet
        weight : float
            With which the distance will count beside half the squared residual.

        Raises
        ------
        InputError
            If parameters are missing or impossible; the message names the link.
        """
        values = self._values(feasible_set)
        bodies = values[feasible_set.link_columns]
        others = np.ones(len(values), dtype=bool)
        others[feasible_set.link_columns] = False
        known = others & np.isfinite(values) & (values != 0)
        diagonal = np.zeros(len(values))
        diagonal[known] = 1.0 / values[known] ** 2
        if self.term_deviations is not None:
            unknown = others & ~known
            deviations = self._vector(self.term_deviations, feasible_set, "term_deviations")
            if not np.all(deviations[unknown] > 0):
                raise InputError(
                    "term_deviations must be positive for every term parameter that the prior does not know, got "
                    f"{deviations[unknown].tolist()} for these."
                )
            diagonal[unknown] = 1.0 / (weight * deviations[unknown] ** 2)
        reference = np.where(np.isfinite(values), values, 0.0)
        return PreparedPrior(self.label, feasible_set, reference, self._metric(feasible_set, bodies), diagonal)

    def distance(self, feasible_set: FeasibleSet, parameters: npt.ArrayLike) -> float:
        """Dimensionless distance of parameters δ from δ₀.

        Parameters
        ----------
        feasible_set : FeasibleSet
        parameters : (n,)
        """
        return self.prepare(feasible_set).distance(feasible_set.as_parameters(parameters))

    @abstractmethod
    def _metric(self, feasible_set: FeasibleSet, bodies: Matrix) -> "npt.NDArray[np.float64] | None":
        """Curvature of the distance in the inertial parameters of each link, (links, 10, 10); None if not constant."""

    def _values(self, feasible_set: FeasibleSet) -> Vector:
        source = feasible_set.model.robot.parameters if self.parameters is None else self.parameters
        values = self._vector(source, feasible_set, "the prior")
        names = feasible_set.model.robot.link_names
        remedy = "give parameters=... with a value for every link" if self.parameters is None else "give one"
        for link, body in enumerate(values[feasible_set.link_columns]):
            where = f"link {link + 1} ({names[link]})"
            if not np.all(np.isfinite(body)):
                source_name = "the robot description" if self.parameters is None else "the prior"
                raise InputError(f"{source_name} has no inertial parameters for {where}; {remedy}.")
            if not body[9] > 0:
                raise InputError(f"the prior's {where} has a mass of {body[9]:g} kg; give a positive mass.")
            if self.needs_density:
                _require_density(body, where)
        return values

    @staticmethod
    def _vector(given: npt.ArrayLike, feasible_set: FeasibleSet, what: str) -> Vector:
        values = np.asarray(given, dtype=float)
        if values.shape != (feasible_set.parameter_count,):
            raise InputError(
                f"{what} must hold the model's {feasible_set.parameter_count} standard parameters, got an array of "
                f"shape {values.shape}."
            )
        return values


def _require_density(body: Vector, where: str) -> None:
    matrix = pseudo_inertia(body)
    sizes = np.sqrt(np.abs(np.diagonal(matrix)))
    sizes[sizes <= 1e-9 * sizes.max()] = 1.0
    least = float(np.linalg.eigvalsh(matrix / np.outer(sizes, sizes))[0])
    if least < SINGULAR:
        kind = "is flat" if least > -SINGULAR else "belongs to no body with positive density"
        raise InputError(
            f'the prior\'s {where} {kind} (it is not feasible under "full" consistency), so that this prior cannot '
            "measure distances from it; give possible parameters, such as those of steelyard.correct, or use "
            "EuclideanPrior."
        )


@dataclass(frozen=True, eq=False)
class EuclideanPrior(Prior):
    """Squared distance from δ₀, in units of each link's mass and size: ½ Σ ((δ - δ₀) / unit)².

    The mass counts in units of the link's mass m, first moments in m r, moments of inertia in m r², where r is the
    largest of its radius of gyration about its frame's origin and 1 cm. Terms count relative to their known values.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> feasible_set = FeasibleSet(Model(Robot.from_dh([("0", 0.0, 0.0, "q")])))
    >>> body = [0.2, 0.0, 0.0, 0.2, 0.0, 0.2, 0.0, 0.0, 0.0, 5.0]
    >>> EuclideanPrior(body).distance(feasible_set, [0.2, 0.0, 0.0, 0.2, 0.0, 0.2, 0.0, 0.0, 0.0, 10.0])
    0.5
    """

    label: ClassVar[str] = "Euclidean"
    needs_density: ClassVar[bool] = False

    def _metric(self, feasible_set: FeasibleSet, bodies: Matrix) -> Matrix:
        sizes = sizes_of_bodies(bodies)
        return np.asarray([np.diag(1.0 / row**2) for row in sizes])


@dataclass(frozen=True, eq=False)
class EntropicPrior(Prior):
    """Log-determinant divergence between pseudo-inertias: Σ tr(P₀⁻¹ P) - log det(P₀⁻¹ P) - 4 over the links.

    It does not depend on the choice of link frames or units, and grows without bound where a link loses its mass or its
    extent, so that answers stay away from the boundary. Only for ``"full"`` consistency. Terms count as
    ½ ((δ - δ₀) / δ₀)².

    References
    ----------
    T. Lee, P. M. Wensing and F. C. Park, Geometric robot dynamic identification: a convex programming approach, IEEE
    Transactions on Robotics 36, 2020.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> feasible_set = FeasibleSet(Model(Robot.from_dh([("0", 0.0, 0.0, "q")])))
    >>> body = np.array([0.2, 0.0, 0.0, 0.2, 0.0, 0.2, 0.0, 0.0, 0.0, 5.0])
    >>> round(EntropicPrior(body).distance(feasible_set, 2 * body), 6)  # 4 (2 - log 2 - 1)
    1.227411
    """

    label: ClassVar[str] = "entropic"

    def _metric(self, feasible_set: FeasibleSet, bodies: Matrix) -> None:
        if feasible_set.consistency != "full":
            raise InputError(
                f'EntropicPrior needs a FeasibleSet with consistency="full", got {feasible_set.consistency!r}, under '
                "which pseudo-inertias may be indefinite; use ConstantPullbackPrior, or full consistency."
            )


@dataclass(frozen=True, eq=False)
class ConstantPullbackPrior(Prior):
    """Second-order approximation of the entropic distance: Σ ½ tr(P₀⁻¹ (P - P₀) P₀⁻¹ (P - P₀)) over the links.

    It does not depend on the choice of link frames or units. Terms count as ½ ((δ - δ₀) / δ₀)².

    References
    ----------
    T. Lee, P. M. Wensing and F. C. Park, Geometric robot dynamic identification: a convex programming approach, IEEE
    Transactions on Robotics 36, 2020.

    Examples
    --------
    >>> from steelyard.dynamics import Model
    >>> from steelyard.feasibility import FeasibleSet
    >>> from steelyard.robot import Robot
    >>> feasible_set = FeasibleSet(Model(Robot.from_dh([("0", 0.0, 0.0, "q")])))
    >>> body = np.array([0.2, 0.0, 0.0, 0.2, 0.0, 0.2, 0.0, 0.0, 0.0, 5.0])
    >>> round(ConstantPullbackPrior(body).distance(feasible_set, 1.1 * body), 6)  # 4 · 0.1² / 2
    0.02
    """

    label: ClassVar[str] = "constant-pullback"

    def _metric(self, feasible_set: FeasibleSet, bodies: Matrix) -> Matrix:
        inverses = np.linalg.inv(pseudo_inertia(bodies))
        products = np.einsum("bij,kjl->bkil", inverses, PSEUDO_INERTIA)
        return np.asarray(np.einsum("bkij,blji->bkl", products, products))


def distance_from(
    parameters: npt.ArrayLike | None, feasible_set: FeasibleSet, deviations: Vector
) -> EntropicPrior | ConstantPullbackPrior:
    """The distance from parameters (n,), those of the description where absent; quadratic without full consistency.

    The deviations (n,) are those of terms.
    """
    kind = EntropicPrior if feasible_set.consistency == "full" else ConstantPullbackPrior
    return kind(parameters, term_deviations=deviations)


@dataclass(frozen=True, eq=False)
class PreparedPrior:
    """A prior of one model, with its metric.

    Attributes
    ----------
    reference : (n,)
        δ₀, zero where unknown.
    metric : (links, 10, 10) or None
        Curvature of the distance in the inertial parameters of each link; None for the log-determinant divergence,
        whose curvature is not constant.
    diagonal : (n,)
        Curvature of the distance in the parameters of the terms, zero where these are unknown.
    """

    label: str
    feasible_set: FeasibleSet = field(repr=False)
    reference: Vector = field(repr=False)
    metric: Matrix | None = field(repr=False)
    diagonal: Vector = field(repr=False)

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Whether the prior knows a value of each parameter, (n,): of links, and of terms that are not zero."""
        found = np.asarray(self.reference != 0.0)
        found[self.feasible_set.link_columns] = True
        return found

    @property
    def name(self) -> str:
        """Completes the sentence "Among all answers this is ...", for remarks."""
        return f"the closest to the {self.label} prior"

    @property
    def bodies(self) -> Matrix:
        """Inertial parameters of every link, (links, 10)."""
        return np.asarray(self.reference[self.feasible_set.link_columns])

    def distance(self, parameters: Vector) -> float:
        """Distance of δ from δ₀; infinite where a pseudo-inertia is not positive definite and the prior needs it."""
        return float(self.distances(parameters[None])[0])

    def distances(self, points: Matrix) -> Vector:
        """Distances of many δ, (p, n), from δ₀, (p,)."""
        errors = points - self.reference
        found = 0.5 * errors**2 @ self.diagonal
        columns = self.feasible_set.link_columns
        if self.metric is not None:
            inertial = errors[:, columns]
            return np.asarray(found + 0.5 * np.einsum("pbi,bij,pbj->p", inertial, self.metric, inertial))
        found += points[:, columns].reshape(len(points), -1) @ self._traces.ravel()
        rest = self._logarithms - log_determinants(pseudo_inertia(points[:, columns]))
        return np.asarray(found + (rest - 4.0).sum(axis=1))

    def gradients(self, points: Matrix) -> Matrix:
        """Gradients of the distances of many δ, (p, n); much cheaper than with the Hessians."""
        found, columns = self.slope(points), self.feasible_set.link_columns
        if self.metric is None:
            inverses = np.linalg.inv(pseudo_inertia(points[:, columns]))
            found[:, columns] -= np.einsum("pbij,kji->pbk", inverses, PSEUDO_INERTIA)
        return found

    def add_derivatives(self, points: Matrix, factors: Vector, gradients: Matrix, hessians: Matrix) -> None:
        """Add the gradients and Hessians of the distances of δ (p, n), each times a factor (p,)."""
        gradients += factors[:, None] * self.slope(points)
        np.einsum("pii->pi", hessians)[...] += factors[:, None] * self.diagonal
        columns = self.feasible_set.link_columns
        if self.metric is not None:
            for own, metric in zip(columns, self.metric, strict=True):
                hessians[:, own[:, None], own] += factors[:, None, None] * metric
            return
        coefficients = np.broadcast_to(PSEUDO_INERTIA, (len(columns), *PSEUDO_INERTIA.shape))
        matrices = pseudo_inertia(points[:, columns])
        add_log_determinants(matrices, coefficients, columns, -factors, gradients, hessians)

    @cached_property
    def _logarithms(self) -> Vector:
        """Those of the determinants of the pseudo-inertias P₀, (links,)."""
        return np.asarray(np.linalg.slogdet(pseudo_inertia(self.bodies))[1])

    @cached_property
    def _traces(self) -> Matrix:
        """tr(P₀⁻¹ ∂P) of the ten inertial parameters of each link, (links, 10)."""
        return np.asarray(np.einsum("bij,kij->bk", np.linalg.inv(pseudo_inertia(self.bodies)), PSEUDO_INERTIA))

    def value(self, parameters: Vector) -> float:
        """The distance."""
        return self.distance(parameters)

    def slope(self, parameters: Matrix) -> Matrix:
        """Gradient of the distance at δ (..., n) without the term -Σ log det P (see `entropy`), (..., n)."""
        error = parameters - self.reference
        found: Matrix = self.diagonal * error
        columns = self.feasible_set.link_columns
        if self.metric is not None:
            found[..., columns] += np.einsum("bij,...bj->...bi", self.metric, error[..., columns])
        else:
            found[..., columns] += self._traces
        return found

    @property
    def entropy(self) -> float:
        """Factor of the term -Σ log det P in the distance: 1 for the log-determinant divergence, else 0."""
        return 1.0 if self.metric is None else 0.0

    def root(self) -> Matrix:
        """G with GᵀG half the curvature of the distance without the term -Σ log det P, (r, n)."""
        rows = [np.diag(np.sqrt(0.5 * self.diagonal))[self.diagonal > 0]]
        if self.metric is not None:
            for body, metric in zip(self.feasible_set.link_columns, self.metric, strict=True):
                values, vectors = np.linalg.eigh(metric)
                own = np.zeros((10, len(self.diagonal)))
                own[:, body] = np.sqrt(0.5 * np.maximum(values, 0.0))[:, None] * vectors.T
                rows.append(own)
        return np.vstack(rows)

    def size(self, parameters: Vector) -> float:
        """Unit in which gaps of the distance are told: the distance, but at least that of a deviation of about 1 %."""
        return max(self.distance(parameters), 1e-4 * len(self.feasible_set.link_columns))

    def curvature(self) -> sparse.csc_array:
        """Curvature of the distance at δ₀, (n, n)."""
        metric = self.metric
        if metric is None:
            metric = ConstantPullbackPrior()._metric(self.feasible_set, self.bodies)
        columns = self.feasible_set.link_columns
        rows = np.repeat(columns[:, :, None], 10, axis=2).ravel()
        across = np.repeat(columns[:, None, :], 10, axis=1).ravel()
        count = len(self.reference)
        bodies = sparse.coo_array((metric.ravel(), (rows, across)), shape=(count, count))
        return sparse.csc_array(bodies + sparse.diags_array(self.diagonal))

    def part(self, program: Program) -> Part:
        """The distance as a part of the objective of a program, up to a constant."""
        matrix = sparse.csc_array(program.scaled_matrix)
        offset = program.origin - self.reference
        if self.metric is not None:
            curvature = self.curvature()
            return _quadratic(matrix, curvature, curvature @ offset)
        terms = _quadratic(matrix, sparse.csc_array(sparse.diags_array(self.diagonal)), self.diagonal * offset)
        return self._divergence(program, terms)

    def _divergence(self, program: Program, terms: Part) -> Part:
        """Σ tr P̃ - log det P̃ with P̃ = L⁻¹ P L⁻ᵀ and P₀ = L Lᵀ, added to the quadratic part of the terms.

        log det P̃ is the largest Σ log Z_ii over lower triangular Z with [[P̃, Z], [Zᵀ, diag Z]] positive semidefinite,
        and t ≤ log Z_ii is an exponential cone (Ben-Tal and Nemirovski, Lectures on modern convex optimization, 4.2).
        """
        shared = program.scaled_matrix.shape[1]
        columns = self.feasible_set.link_columns
        links = len(columns)
        own = 14 * links
        q = np.concatenate([terms.q, np.zeros(own)])
        factors = np.linalg.cholesky(pseudo_inertia(self.bodies))
        rows = []
        for link, (body, factor) in enumerate(zip(columns, factors, strict=True)):
            inverse = scipy.linalg.solve_triangular(factor, np.eye(4), lower=True)
            basis = inverse @ PSEUDO_INERTIA @ inverse.T
            matrices = np.tensordot(basis, program.scaled_matrix[body], axes=(0, 0))  # (4, 4, m)
            constant = np.tensordot(program.origin[body], basis, axes=1)
            q[:shared] += np.trace(matrices)
            start = shared + 14 * link
            q[start + 10 : start + 14] = -1.0
            rows.append(_triangular_rows(matrices, constant, start, shared + own))
            rows.append(_logarithm_rows(start, shared + own))
        P = sparse.csc_array(
            (terms.P.data, terms.P.indices, np.append(terms.P.indptr, np.full(own, terms.P.indptr[-1]))),
            shape=(shared + own, shared + own),
        )
        return Part(P, q, tuple(row for group in rows for row in group), own)


def _quadratic(matrix: sparse.csc_array, curvature: sparse.csc_array, gradient: Vector) -> Part:
    P = sparse.csc_array(sparse.triu(matrix.T @ (curvature @ matrix), format="csc"))
    return Part(P, np.asarray(matrix.T @ gradient))


_ROW, _COLUMN = np.tril_indices(4)


def _triangular_rows(matrices: npt.NDArray[np.float64], constant: Matrix, start: int, size: int) -> tuple[Rows, ...]:
    """[[P̃, Z], [Zᵀ, diag Z]] ⪰ 0, where the ten elements of the lower triangle of Z begin at `start`."""
    shared = matrices.shape[2]
    coefficients = np.zeros((8, 8, size))
    coefficients[:4, :4, :shared] = matrices
    for element, (i, j) in enumerate(zip(_ROW, _COLUMN, strict=True)):
        coefficients[i, 4 + j, start + element] = coefficients[4 + j, i, start + element] = 1.0
        if i == j:
            coefficients[4 + i, 4 + i, start + element] = 1.0
    whole = np.zeros((8, 8))
    whole[:4, :4] = constant
    row, column, scale = stacked_triangle(8)
    left = sparse.csc_array(-coefficients[row, column] * scale[:, None])
    return (Rows(left, whole[row, column] * scale, Cone("semidefinite", 8)),)


def _logarithm_rows(start: int, size: int) -> tuple[Rows, ...]:
    """t_i ≤ log Z_ii, where the four t follow the ten elements of Z."""
    found = []
    for element, i in enumerate(np.flatnonzero(_ROW == _COLUMN)):
        left = np.zeros((3, size))
        left[0, start + 10 + element] = left[2, start + i] = -1.0
        found.append(Rows(sparse.csc_array(left), np.array([0.0, 1.0, 0.0]), Cone("exponential", 3)))
    return tuple(found)
