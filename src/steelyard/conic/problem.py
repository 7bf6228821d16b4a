"""Conic problems and their solutions, and the errors of a solution, measured in the same way for every solver."""

import enum
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import InputError, SolverError

__all__ = [
    "CONE_KINDS",
    "Cone",
    "ConicProblem",
    "ConicSolution",
    "Outcome",
    "Rows",
    "dual_error",
    "gap_error",
    "infeasibility_error",
    "least_distance",
    "optimality_error",
    "primal_error",
    "recession_error",
    "stacked_triangle",
]

Vector = npt.NDArray[np.float64]

CONE_KINDS = ("zero", "nonnegative", "second-order", "semidefinite", "exponential")
"""Kinds of cones that a problem may contain."""


class Outcome(enum.Enum):
    """The outcome of a solver; the value is the text for the user."""

    SOLVED = "solved"
    ALMOST_SOLVED = "solved to reduced accuracy"
    INFEASIBLE = "no point satisfies the constraints"
    UNBOUNDED = "the objective is unbounded"
    STOPPED = "stopped before the accuracy asked for was reached"

    @property
    def usable(self) -> bool:
        """Whether the point may be used once it has been verified."""
        return self in (Outcome.SOLVED, Outcome.ALMOST_SOLVED, Outcome.STOPPED)


@dataclass(frozen=True)
class Cone:
    """One cone of the product K.

    Attributes
    ----------
    kind : str
        ``"zero"``: s = 0. ``"nonnegative"``: s ≥ 0. ``"second-order"``: s₁ ≥ ‖(s₂, …)‖. ``"semidefinite"``: a symmetric
        matrix, whose upper triangle is stacked by columns, off-diagonal elements times √2. ``"exponential"``: the
        closure of s₃ ≥ s₂ exp(s₁ / s₂), s₂ > 0.
    size : int
        Number of rows; for ``"semidefinite"`` the order d of the matrix, which takes d (d + 1) / 2 rows. Always 3 for
        ``"exponential"``.

    Raises
    ------
    InputError
        For an unknown kind or a size that the kind cannot have.

    Examples
    --------
    >>> Cone("semidefinite", 4).rows
    10
    """

    kind: str
    size: int

    def __post_init__(self) -> None:
        if self.kind not in CONE_KINDS:
            raise InputError(f"there is no cone {self.kind!r}; the kinds are {', '.join(CONE_KINDS)}.")
        if self.size < 0 or (self.kind == "exponential" and self.size != 3):
            expected = "is of size 3" if self.kind == "exponential" else "has a size of at least 0"
            raise InputError(f"a {self.kind} cone {expected}, got {self.size}.")

    @property
    def rows(self) -> int:
        """Rows that the cone takes."""
        return self.size * (self.size + 1) // 2 if self.kind == "semidefinite" else self.size


@lru_cache(maxsize=64)
def stacked_triangle(size: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Vector]:
    """Return how a symmetric matrix is stacked in the rows of a semidefinite cone.

    Parameters
    ----------
    size : int
        Order d of the matrix.

    Returns
    -------
    (rows,), (rows,), (rows,)
        Row and column of each element of the upper triangle, stacked by columns, and its factor: 1, or √2 off the
        diagonal, with which the dot product of two vectors is the trace inner product of the two matrices.

    Examples
    --------
    >>> row, column, factor = stacked_triangle(2)
    >>> row.tolist(), column.tolist(), factor.round(4).tolist()
    ([0, 0, 1], [0, 1, 1], [1.0, 1.4142, 1.0])
    """
    column, row = np.tril_indices(size)
    found = row, column, np.where(row == column, 1.0, np.sqrt(2.0))
    for array in found:
        array.flags.writeable = False  # they are kept
    return found


@dataclass(frozen=True, eq=False)
class Rows:
    """Some rows of a conic problem: matrix x + s = right, s in the product of the cones.

    Attributes
    ----------
    matrix : (k, m), sparse or dense
        Coefficients of the first m unknowns of a problem; the others have none.
    right : (k,)
    *cones : Cone
        In the order of the rows.
    """

    matrix: sparse.csc_array
    right: Vector
    cones: tuple[Cone, ...]

    def __init__(self, matrix: sparse.sparray | npt.NDArray[np.float64], right: Vector, *cones: Cone) -> None:
        object.__setattr__(self, "matrix", sparse.csc_array(matrix))
        object.__setattr__(self, "right", right)
        object.__setattr__(self, "cones", cones)

    def over(self, unknowns: int) -> sparse.csc_array:
        """The matrix with columns of zeros for the other unknowns, (k, unknowns)."""
        rows, own = self.matrix.shape
        if own == unknowns:
            return self.matrix
        indptr = np.append(self.matrix.indptr, np.full(unknowns - own, self.matrix.indptr[-1]))
        return sparse.csc_array((self.matrix.data, self.matrix.indices, indptr), shape=(rows, unknowns))


@dataclass(frozen=True, eq=False)
class ConicProblem:
    """Minimise ½ xᵀP x + qᵀx subject to A x + s = b, s in K.

    Attributes
    ----------
    P : (n, n) sparse, symmetric (its upper triangle is used), positive semidefinite
    q : (n,)
    A : (rows, n) sparse
    b : (rows,)
    cones : tuple of Cone, in the order of the rows
    balanced : bool
        Whether the units are suitable already, so that the problem need not be scaled; P then holds its upper triangle
        alone.
    degenerate : bool
        Whether many points are known to be solutions alike, so that a solver had better begin with care.

    Raises
    ------
    InputError
        If the sizes do not fit together or a number is not finite.
    """

    P: sparse.csc_array
    q: Vector
    A: sparse.csc_array
    b: Vector
    cones: tuple[Cone, ...]
    balanced: bool = False
    degenerate: bool = False

    def __post_init__(self) -> None:
        for name in ("P", "A"):
            matrix = getattr(self, name)
            if not isinstance(matrix, sparse.csc_array):
                object.__setattr__(self, name, sparse.csc_array(matrix))
        count, rows = len(self.q), len(self.b)
        taken = sum(cone.rows for cone in self.cones)
        if self.P.shape != (count, count) or self.A.shape != (rows, count) or taken != rows:
            raise InputError(
                f"a conic problem with {count} unknowns and {rows} rows needs P of shape ({count}, {count}), A of "
                f"shape ({rows}, {count}) and cones of {rows} rows together, got {self.P.shape}, {self.A.shape} and "
                f"{taken}."
            )
        for name, values in (("P", self.P.data), ("q", self.q), ("A", self.A.data), ("b", self.b)):
            if not np.all(np.isfinite(values)):
                raise InputError(f"{name} of a conic problem must be finite, but an element is not; check its data.")

    @classmethod
    def from_rows(
        cls, q: Vector, rows: Sequence[Rows], P: sparse.csc_array | None = None, balanced: bool = False
    ) -> "ConicProblem":
        """Put a problem together from its rows.

        Parameters
        ----------
        q : (n,)
        rows : sequence of Rows
            Over all unknowns, or over the first ones.
        P : (n, n) sparse, optional
            Zero where absent.
        balanced : bool

        Examples
        --------
        The largest x with x ≤ 2:

        >>> problem = ConicProblem.from_rows(-np.ones(1), [Rows(np.eye(1), np.array([2.0]), Cone("nonnegative", 1))])
        >>> problem.A.toarray().tolist(), problem.b.tolist()
        ([[1.0]], [2.0])
        """
        count = len(q)
        return cls(
            P=sparse.csc_array((count, count)) if P is None else P,
            q=q,
            A=sparse.csc_array(sparse.vstack([part.over(count) for part in rows], format="csc")),
            b=np.concatenate([part.right for part in rows]),
            cones=tuple(cone for part in rows for cone in part.cones),
            balanced=balanced,
        )

    @property
    def symmetric(self) -> "ConicProblem":
        """The same problem with both triangles of P."""
        upper = sparse.triu(self.P, format="csc")
        return ConicProblem(sparse.csc_array(upper + sparse.triu(upper, 1).T), self.q, self.A, self.b, self.cones)


@dataclass(frozen=True, eq=False)
class ConicSolution:
    """The answer of a solver.

    Attributes
    ----------
    outcome : Outcome
    status : str
        The solver's own status.
    primal : (n,)
        x.
    slack : (rows,)
        s.
    dual : (rows,)
        z, in the dual cone. For `Outcome.INFEASIBLE` a direction that proves it: Aᵀz = 0, bᵀz < 0.
    objective : float
    iterations : int
    seconds : float
        Time that the solver itself took.
    solver : str
        Title of the solver, for messages.
    """

    outcome: Outcome
    status: str
    primal: Vector = field(repr=False)
    slack: Vector = field(repr=False)
    dual: Vector = field(repr=False)
    objective: float
    iterations: int
    seconds: float
    solver: str = "Clarabel"

    @property
    def usable(self) -> bool:
        """Whether there is a finite point that may be used once it has been verified."""
        return self.outcome.usable and bool(np.all(np.isfinite(self.primal)))

    def require(self, purpose: str) -> "ConicSolution":
        """Return the solution itself if its point may be used, else raise.

        Raises
        ------
        SolverError
            If not; the message names what was computed, the status and the remedy.
        """
        if self.usable:
            return self
        raise SolverError(
            f"{self.solver} could not {purpose}: {self.outcome.value} (status {self.status}, {self.iterations} "
            "iterations); check that the constraints do not contradict each other and that units are SI."
        )


def _largest(*vectors: Vector) -> float:
    return max(float(np.abs(vector).max(initial=0.0)) for vector in vectors)


def primal_error(problem: ConicProblem, primal: Vector, slack: Vector) -> float:
    """Largest element of A x + s - b, relative to the largest of the three (at least 1)."""
    left = problem.A @ primal
    return _largest(left + slack - problem.b) / (1.0 + _largest(left, slack, problem.b))


def dual_error(problem: ConicProblem, primal: Vector, dual: Vector) -> float:
    """Largest element of P x + q + Aᵀz, relative to the largest of the three (at least 1)."""
    curvature, pull = problem.P @ primal, problem.A.T @ dual
    return _largest(curvature + problem.q + pull) / (1.0 + _largest(curvature, problem.q, pull))


def gap_error(problem: ConicProblem, primal: Vector, dual: Vector) -> float:
    """Difference between the objectives of x and z, relative to the larger of them (at least 1)."""
    quadratic = float(primal @ (problem.P @ primal))
    above = 0.5 * quadratic + float(problem.q @ primal)
    below = -0.5 * quadratic - float(problem.b @ dual)
    return abs(above - below) / (1.0 + max(abs(above), abs(below)))


def optimality_error(problem: ConicProblem, primal: Vector, slack: Vector, dual: Vector) -> float:
    """Largest of the relative errors of a point: primal, dual, and the gap between both objectives.

    Whether s lies in K and z in its dual cone is not checked.

    Parameters
    ----------
    problem : ConicProblem
        Both triangles of P must be given, as in `ConicProblem.symmetric`.
    primal : (n,)
    slack, dual : (rows,)

    Returns
    -------
    float
        Infinite where an element is not finite.
    """
    if not all(np.all(np.isfinite(vector)) for vector in (primal, slack, dual)):
        return float("inf")
    errors = (primal_error(problem, primal, slack), dual_error(problem, primal, dual), gap_error(problem, primal, dual))
    return max(errors)


def infeasibility_error(problem: ConicProblem, dual: Vector) -> float:
    """Error of z as a proof that no point exists: the largest element of Aᵀz, after z is scaled such that bᵀz = -1.

    Returns
    -------
    float
        Infinite where bᵀz is not negative.
    """
    if not np.all(np.isfinite(dual)):
        return float("inf")
    value = float(problem.b @ dual)
    return _largest(problem.A.T @ dual) / -value if value < 0 else float("inf")


def recession_error(problem: ConicProblem, direction: Vector) -> float:
    """Error of d as a proof that the objective is unbounded, which needs -A d in K and P d = 0, scaled to qᵀd = -1.

    Returns
    -------
    float
        Infinite where qᵀd is not negative.
    """
    if not np.all(np.isfinite(direction)):
        return float("inf")
    value = float(problem.q @ direction)
    if value >= 0:
        return float("inf")
    outside = -least_distance(problem.cones, -(problem.A @ direction))
    return max(outside, _largest(problem.P @ direction)) / -value


def least_distance(cones: tuple[Cone, ...], vector: Vector) -> float:
    """Signed distance of a vector from the boundary of the product of the cones: positive inside, negative outside.

    For a semidefinite cone it is the smallest eigenvalue, for a zero cone minus the largest element. Exponential cones
    are left out. The result is minus infinity if an element is not finite.
    """
    if not np.all(np.isfinite(vector)):
        return -float("inf")
    least, start = float("inf"), 0
    for cone in cones:
        part = vector[start : start + cone.rows]
        start += cone.rows
        if not cone.size:
            continue
        if cone.kind == "zero":
            depth = -float(np.abs(part).max())
        elif cone.kind == "nonnegative":
            depth = float(part.min())
        elif cone.kind == "second-order":
            depth = float(part[0] - np.linalg.norm(part[1:]))
        elif cone.kind == "semidefinite":
            matrix = np.zeros((cone.size, cone.size))
            row, column, factor = stacked_triangle(cone.size)
            matrix[column, row] = part / factor
            depth = float(np.linalg.eigvalsh(matrix)[0])
        else:
            continue
        least = min(least, depth)
    return least
