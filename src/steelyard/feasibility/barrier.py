"""The logarithmic barrier of a feasible set, and Newton's method on it, for many problems at once.

Where dozens of similar problems are to be solved to a few per cent (every weight of a prior on every fold, both ends of
every interval), their Newton systems are small and all of one shape. Solved side by side they take a hundredth of what
as many calls of a conic solver take. Answers that must be proved optimal are left to the conic solver.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import in_threads
from steelyard.lmi import AffineBlock
from steelyard.once import cached_property
from steelyard.robot.inertia import PSEUDO_INERTIA

from .barrier_code import add_derivatives, add_squares, pivots
from .feasible_set import FeasibleSet

__all__ = [
    "Barrier",
    "Function",
    "LinearConditions",
    "add_log_determinants",
    "log_determinants",
    "matrix_conditions",
    "minimise",
    "newton_solutions",
]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Tensor = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

TOGETHER = 16
"""Problems whose Hessians are made and solved together: those of a robot with seven joints stay in the cache."""

SUFFICIENT = 0.1
"""Part of the decrease that the Newton step promises, with which a step is taken (Armijo's rule)."""

HALVINGS = 40
"""A step that has been halved so often moves nothing: the problem has gone as far as rounding lets it."""

TRIED_TOGETHER = 40
"""Points at which a function is tried together where steps are halved, at most: of few problems, several halvings of
each. What a trial of one point costs is mostly calls: the heaviest weight of a prior took 109 trials for twenty steps,
a fifth of the time of a cross-validation, and takes 35."""

RIDGE = 1e-13
"""Relative to the diagonal of a Hessian, and added to it, so that directions which neither data nor physics tell leave
a matrix that can be solved; ten times less, and some are singular to rounding."""


class Function(Protocol):
    """A convex function of many points at once, each point belonging to a problem of its own."""

    def value(self, points: Matrix, problems: Indices) -> Vector:
        """At points (p, n) of the problems with these numbers (p,), infinite outside the domain; (p,)."""

    def derivatives(self, points: Matrix, problems: Indices) -> tuple[Matrix, npt.NDArray[np.float64]]:
        """Gradients (p, n) and Hessians (p, n, n) at points of the domain."""


class Barrier:
    """-Σ log det D_b(δ) over the blocks of a feasible set, for many δ at once.

    Parameters
    ----------
    further : sequence of AffineBlock
        Blocks that count beside those of the set.

    Attributes
    ----------
    has_bodies : bool
        Whether the pseudo-inertias of all links, as they are, are among the blocks, so that they can count more.

    Examples
    --------
    >>> import steelyard as sy
    >>> robot = sy.Robot.from_dh([("0", 0.0, 0.0, "q")])
    >>> barrier = Barrier(sy.FeasibleSet(sy.Model(robot)))
    >>> body = np.array([0.2, 0.0, 0.0, 0.2, 0.0, 0.2, 0.0, 0.0, 0.0, 5.0])
    >>> round(float(barrier.value(np.array([body, 2 * body]))[1] - barrier.value(body[None])[0]), 6)
    -2.772589
    """

    def __init__(self, feasible_set: FeasibleSet, further: Sequence[AffineBlock] = ()) -> None:
        self.size = feasible_set.parameter_count
        blocks = (*feasible_set.blocks, *further)
        self._lines = LinearConditions(blocks, self.size)
        self._groups = matrix_conditions(blocks)
        self._bodies = next((g for g, group in enumerate(self._groups) if _of_bodies(group, feasible_set)), None)
        self.has_bodies = self._bodies is not None

    def value(self, points: Matrix, of_bodies: Vector | None = None) -> Vector:
        """At points (p, n); infinite where a block is not positive definite.

        The pseudo-inertias count so many times (p,), where the barrier has them.
        """
        found = np.zeros(len(points))
        if len(self._lines.rows):
            values = points @ self._lines.rows.T + self._lines.constants
            positive = values > 0
            if positive.all():
                found = -np.log(values).sum(axis=1)
            else:
                found = -np.log(np.where(positive, values, 1.0)).sum(axis=1)
                found[~positive.all(axis=1)] = np.inf
        for number, (indices, coefficients, constants) in enumerate(self._groups):
            own = log_determinants(_values(points[:, indices], coefficients, constants)).sum(axis=1)
            found = found - (own if of_bodies is None or number != self._bodies else of_bodies * own)
        return found

    def add_derivatives(
        self, points: Matrix, factors: Vector, gradients: Matrix, hessians: Matrix, of_bodies: Vector | None = None
    ) -> None:
        """Add the gradients and Hessians at points (p, n), each times a factor (p,); `of_bodies` is as in `value`."""
        if len(self._lines.rows):
            inverses = 1.0 / (points @ self._lines.rows.T + self._lines.constants)
            gradients -= factors[:, None] * (inverses @ self._lines.rows)
            self._lines.add_squares(np.sqrt(factors)[:, None] * inverses, hessians)
        for number, (indices, coefficients, constants) in enumerate(self._groups):
            matrices = _values(points[:, indices], coefficients, constants)
            own_factors = factors if of_bodies is None or number != self._bodies else factors * of_bodies
            add_log_determinants(matrices, coefficients, indices, -own_factors, gradients, hessians)


def _of_bodies(group: tuple[Indices, Tensor, Tensor], feasible_set: FeasibleSet) -> bool:
    """Say whether blocks of one shape are the pseudo-inertias of all links, without further conditions."""
    indices, coefficients, constants = group
    return (
        np.array_equal(indices, feasible_set.link_columns)
        and coefficients.shape[1:] == PSEUDO_INERTIA.shape
        and bool(np.all(coefficients == PSEUDO_INERTIA))
        and not constants.any()
    )


def _values(own: Tensor, coefficients: Tensor, constants: Tensor) -> Tensor:
    """Matrices (p, b, d, d) of blocks whose unknowns are (p, b, c)."""
    blocks, count, size, _ = coefficients.shape
    products = own.swapaxes(0, 1) @ coefficients.reshape(blocks, count, size * size)
    return np.asarray(constants + products.swapaxes(0, 1).reshape(-1, blocks, size, size))


class LinearConditions:
    """The 1 x 1 blocks among some: rows · δ + constants must be positive.

    Parameters
    ----------
    size : int
        Number of parameters.

    Attributes
    ----------
    rows : (b, n)
    constants : (b,)
    """

    def __init__(self, blocks: Sequence[AffineBlock], size: int) -> None:
        lines = [block for block in blocks if block.size == 1]
        self.rows = np.zeros((len(lines), size))
        for row, block in zip(self.rows, lines, strict=True):
            np.add.at(row, block.indices, block.coefficients[:, 0, 0])
        self.constants = np.array([block.constant[0, 0] for block in lines])

    @cached_property
    def _sparse(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Vector]:
        """Where the elements of each row begin, their columns, and the elements."""
        rows, columns = np.nonzero(self.rows)
        starts = np.searchsorted(rows, np.arange(len(self.rows) + 1))
        return starts.astype(np.int64), columns.astype(np.int64), self.rows[rows, columns]

    def add_squares(self, factors: Matrix, hessians: Tensor) -> None:
        """Add (f r)(f r)ᵀ of all rows r, with factors f of each point (p, b), to matrices (p, n, n)."""
        add_squares(*self._sparse, factors, hessians)


def matrix_conditions(blocks: Sequence[AffineBlock]) -> list[tuple[Indices, Tensor, Tensor]]:
    """The larger blocks among some: indices (b, c), coefficients (b, c, d, d) and constants of those of each shape."""
    groups: dict[tuple[int, int], list[AffineBlock]] = {}
    for block in blocks:
        if block.size > 1:
            groups.setdefault((block.size, len(block.indices)), []).append(block)
    return [
        (
            np.array([block.indices for block in group]),
            np.array([block.coefficients for block in group]),
            np.array([block.constant for block in group]),
        )
        for group in groups.values()
    ]


def log_determinants(matrices: Matrix) -> Matrix:
    """Return log-determinants of symmetric matrices (..., d, d); -inf where they are not positive definite."""
    found = pivots(np.ascontiguousarray(matrices))
    return np.where(np.all(found > 0.0, axis=-1), np.log(np.abs(found)).sum(axis=-1), -np.inf)


def add_log_determinants(
    matrices: Matrix, coefficients: Matrix, indices: Indices, factors: Vector, gradients: Matrix, hessians: Matrix
) -> None:
    """Add the derivatives of Σ log det of affine matrices, each times a factor.

    Parameters
    ----------
    matrices : (p, b, d, d)
        Their values at each point.
    coefficients : (b, c, d, d)
    indices : (b, c)
        Of the unknowns that the coefficients belong to.
    factors : (p,)
    gradients : (p, n)
    hessians : (p, n, n)
    """
    matrices, coefficients, factors = (np.ascontiguousarray(one) for one in (matrices, coefficients, factors))
    add_derivatives(matrices, coefficients, indices.astype(np.int64), factors, gradients, hessians)


MOST_STEPS = 100
"""Largest number of Newton steps of a minimisation."""


def minimise(
    function: Function,
    start: Matrix,
    basis: Matrix | None = None,
    accuracy: float = 1e-3,
    problems: Indices | None = None,
) -> Matrix:
    """Minimise a function from each of many points, by damped Newton steps; (p, n).

    Parameters
    ----------
    function : Function
    start : (p, n)
        Points of its domain.
    basis : (n, m), optional
        Directions in which the points may move, such as those along which equations hold; all where absent.
    accuracy : float
        A problem is solved where a Newton step promises a decrease of less.
    problems : (p,), optional
        Which of the problems of the function that of each point is; k for the k-th point where absent.
    """
    points = np.array(start, dtype=float)
    active = np.arange(len(points))
    which = active if problems is None else problems
    values = function.value(points, which)
    for _ in range(MOST_STEPS):
        step, decrease = _newton_step(function, points[active], which[active], basis)
        points[active], values[active] = _damped(
            function, points[active], which[active], values[active], step, decrease
        )
        active = active[0.5 * decrease > accuracy]
        if not len(active):
            break
    return points


def _newton_step(
    function: Function, points: Matrix, problems: Indices, basis: Matrix | None = None
) -> tuple[Matrix, Vector]:
    """The Newton step at every point (p, n), and the square of its length in the local metric (p,)."""
    step, decrease = np.empty_like(points), np.empty(len(points))

    def solve(start: int) -> None:
        own = slice(start, start + TOGETHER)
        gradients, hessians = function.derivatives(points[own], problems[own])
        step[own] = newton_solutions(hessians, -gradients[:, None], basis)[:, 0]
        decrease[own] = np.maximum(-np.einsum("pi,pi->p", gradients, step[own]), 0.0)

    in_threads(solve, range(0, len(points), TOGETHER))
    return step, decrease


def newton_solutions(hessians: Tensor, rows: Tensor, basis: Matrix | None) -> Tensor:
    """H⁻¹ times the vectors (p, k, n) of each problem, within the directions of a basis.

    Where rounding leaves a Hessian that is not positive definite, its least singular values count as none.
    """
    from scipy.linalg.lapack import dposv

    if basis is not None:
        rows, hessians = rows @ basis, basis.T @ hessians @ basis
    found = np.empty_like(rows)
    diagonals = np.einsum("pii->pi", hessians)
    diagonals *= 1.0 + RIDGE
    for hessian, diagonal, row, own in zip(hessians, diagonals, rows, found, strict=True):
        # Symmetric, so that its transpose, which LAPACK takes without a copy, is the same; half of the time of LU.
        _, solved, fails = dposv(hessian.T, row.T, lower=1)
        if fails:
            sizes = np.sqrt(np.maximum(diagonal, 0.0))
            sizes[sizes == 0] = 1.0
            scaled = hessian / sizes / sizes[:, None]
            solved = (np.linalg.lstsq(scaled, (row / sizes).T, rcond=1e-14)[0].T / sizes).T
        own[:] = solved.T
    return found if basis is None else np.asarray(found @ basis.T)


def _damped(
    function: Function, points: Matrix, problems: Indices, values: Vector, step: Matrix, decrease: Vector
) -> tuple[Matrix, Vector]:
    """Points after a step that is halved until the function falls enough, and its values there."""
    slack = 1e-12 * np.abs(values)
    found = points + step
    reached = function.value(found, problems)
    going = np.flatnonzero(~(reached <= values - SUFFICIENT * decrease + slack))
    halved = 0
    while len(going) and halved < HALVINGS:
        count = min(max(TRIED_TOGETHER // len(going), 1), HALVINGS - halved)
        lengths = 0.5 ** np.arange(halved + 1, halved + count + 1)
        tried = points[going, None] + lengths[:, None] * step[going, None]
        there = function.value(tried.reshape(-1, points.shape[1]), np.repeat(problems[going], count))
        there = there.reshape(-1, count)
        enough = there <= (values + slack)[going, None] - SUFFICIENT * lengths * decrease[going, None]
        first, falls = enough.argmax(axis=1), enough.any(axis=1)
        found[going[falls]], reached[going[falls]] = tried[falls, first[falls]], there[falls, first[falls]]
        going, halved = going[~falls], halved + count
    found[going], reached[going] = points[going], values[going]
    return found, reached
