"""Bounds that follow from a solver's dual point but do not depend on the solver's accuracy.

By weak duality, every dual point that satisfies the dual equations gives a bound. A solver satisfies these only to its
accuracy. `Mending` changes the dual point such that they hold to rounding; the rest is subtracted from the bound, which
then holds for robots up to a certain size. Two classes use it: `SliceBound` for bounds of single quantities, and
`ConvexProblem` for lower bounds of the objective of a fit. Proofs without such a restriction are exact dual points, in
`exact_dual_point`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from steelyard.lmi import AffineStack, symmetric_to_vector, vector_to_symmetric
from steelyard.once import cached_property

from .feasible_set import FeasibleSet

if TYPE_CHECKING:
    from .bounds.analytic_center import AnalyticCenter

__all__ = ["EPSILON", "PARAMETER_BOUND", "ConvexProblem", "Mending", "Multipliers", "SliceBound"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

DAMPINGS = (1e-14, 1e-12, 1e-9, 1e-6, 1e-4)
"""Regularisations of the least-squares steps of mending, relative to the largest singular value; all are tried, and the
best bound is taken. Small ones are accurate, large ones keep steps short where the equations are nearly dependent: on
100 random fits 1e-4 alone leaves one gap of 8e-5 and takes 60 % more iterations, 1e-14 or 1e-9 alone would do."""

EPSILON = float(np.finfo(float).eps)


class Mending:
    """Newton steps that reduce the error of the equations Σ <B_j, Z_b> + further_j · p = target_j of a dual point.

    Z becomes Z^½ (1 + X) Z^½, where X and the steps of p have the least norm. So the null space of Z stays, and Z
    remains positive semidefinite for small X.

    Parameters
    ----------
    matrices : sequence of (b, d, d)
        Z ⪰ 0 of the blocks of each size.
    coefficients : sequence of (b, m, d, d)
        B_j of the same blocks.
    """

    def __init__(self, matrices: Sequence[Matrix], coefficients: Sequence[Matrix]) -> None:
        self._matrices = matrices
        self._roots = [_with_eigenvalues(Z, np.sqrt) for Z in matrices]
        self._columns = []
        for root, B in zip(self._roots, coefficients, strict=True):
            products = symmetric_to_vector(root[:, None] @ B @ root[:, None])
            self._columns.append(np.moveaxis(products, 1, 0).reshape(B.shape[1], -1))

    def steps(
        self, missing: Vector, further: Matrix, most: float = np.inf
    ) -> Iterator[tuple[tuple[Matrix, ...], Vector]]:
        """Mended matrices and steps of p, one pair for each regularisation.

        Parameters
        ----------
        missing : (m,)
            Error of the equations.
        further : (m, k)
            Coefficients of p, in units in which a step of 1 may be taken.
        most : float
            Steps in which an element of X or of p exceeds this are left out.
        """
        left, values, right = np.linalg.svd(np.hstack([*self._columns, further]), full_matrices=False)
        along, largest = left.T @ missing, float(values.max(initial=0.0)) or 1.0
        for damping in DAMPINGS:
            step = right.T @ (along * values / (values**2 + (damping * largest) ** 2))
            if float(np.abs(step).max(initial=0.0)) > most:
                continue
            found, start = [], 0
            for Z, root in zip(self._matrices, self._roots, strict=True):
                stop = start + len(Z) * (Z.shape[1] * (Z.shape[1] + 1) // 2)
                change = vector_to_symmetric(step[start:stop].reshape(len(Z), -1))
                found.append(positive(Z + root @ change @ root))
                start = stop
            yield tuple(found), step[start:]


def positive(matrices: Matrix) -> Matrix:
    """The nearest semidefinite matrices, (b, d, d)."""
    return _with_eigenvalues(matrices, lambda values: values)


def _with_eigenvalues(matrices: Matrix, function: Callable[[Vector], Vector]) -> Matrix:
    """A function of symmetric matrices, applied to their eigenvalues; negative ones count as zero."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray(np.einsum("bij,bj,bkj->bik", vectors, function(np.maximum(values, 0.0)), vectors))


TRACE_BOUND_FACTOR = 1e2
"""The bounds hold for robots whose traces add up to at most this many times the bound with which the analytic center
was found."""

SLICE_STEPS = 4
"""Largest number of mending steps for a bound of one quantity; they end when a step gains less than 1e-9."""

LARGEST_STEP = 0.5
"""Largest element of X in a step. Larger steps, or a regularisation of 1e-3, lead to other dual points than that of the
solver, whose bounds reflect the trace bound alone: the centre of mass of a link that may be massless came out as
bounded by 1e5 m instead of unbounded."""

LEAST_PULL = 1e-6
"""Step that mending may take in the multiplier of the region if that is zero."""


class SliceBound:
    """Lower bounds of combinations c·δ over a slice, from dual matrices.

    In the coordinates v around the analytic center, c·v ≥ -Σ tr Z_b + g·v with g_j = c_j - Σ <B_j, Z_b>, for any Z ⪰ 0.
    Within the confidence region g·v has a least value. Along the other directions g vanishes up to rounding, and the
    rest is multiplied by the largest possible length of v, which follows from the trace bound.
    """

    def __init__(self, center: "AnalyticCenter") -> None:
        self.center = center
        count = len(center.point)
        second = center.ball[1]
        # Directions of v that do not change u.
        still = np.linalg.svd(second)[2][np.linalg.matrix_rank(second) :] if len(second) else np.eye(count)
        self._still = still.T
        self._to_pull = np.linalg.pinv(second.T)
        order = sum(group.size * len(group.indices) for group in center.groups)
        self._radius = 4.0 * TRACE_BOUND_FACTOR * (order + 2.0)

    @property
    def trace_bound(self) -> float:
        """The bounds hold for robots whose traces of all blocks (kg, kg m², ...) add up to less than this."""
        return TRACE_BOUND_FACTOR * self.center.size

    def of(self, row: Vector, duals: tuple[Matrix, ...], pull: Vector) -> float:
        """The lower bound of row · δ, rounded down; -inf if the matrices are not finite.

        Parameters
        ----------
        row : (n,)
        duals : tuple of (b, d, d)
            Z of each group, in the units of the analytic center, for the objective scaled to length 1.
        pull : (k,)
            Multiplier of the region: Σ <B_j, Z_b> + (secondᵀ pull)_j = c_j, to the solver's accuracy.
        """
        objective = self.center.directions.T @ row
        length = float(np.linalg.norm(objective))
        if length == 0.0:
            return float(row @ self.center.parameters)
        if not all(np.all(np.isfinite(Z)) for Z in (*duals, pull)):
            return -np.inf
        target = objective / length
        matrices = tuple(positive(Z) for Z in duals)
        best = self._value(target, matrices)
        for _ in range(SLICE_STEPS):
            mended = max(
                ((self._value(target, Z), Z, p) for Z, p in self._mended(target, matrices, pull)),
                key=lambda found: found[0],
                default=None,
            )
            if mended is None or mended[0] <= best:
                break
            gain, (best, matrices, pull) = mended[0] - best, mended
            if gain < 1e-9:
                break
        size = float(np.abs(row) @ np.abs(self.center.parameters))
        return float(row @ self.center.parameters) + length * best - 4 * EPSILON * size

    def _value(self, target: Vector, matrices: tuple[Matrix, ...]) -> float:
        """The bound that given matrices prove."""
        value = -sum(float(np.einsum("bii->", Z)) for Z in matrices)
        rest = target - self._products(matrices)
        first = self.center.ball[0]
        if len(first):
            # rest · v = pull · (u - first), which is least at the edge of the region.
            pull = self._to_pull @ rest
            value -= float(np.linalg.norm(pull) + pull @ first)
        left = float(np.linalg.norm(self._still.T @ rest))
        return value - left * self._radius - 16 * EPSILON * abs(value)

    def _products(self, matrices: tuple[Matrix, ...]) -> Vector:
        """Σ <B_j, Z_b> for every j."""
        total = np.zeros(len(self.center.point))
        for group, Z in zip(self.center.groups, matrices, strict=True):
            total += np.einsum("bqij,bij->q", group.coefficients, Z)
        return total

    def _mended(
        self, target: Vector, matrices: tuple[Matrix, ...], pull: Vector
    ) -> Iterator[tuple[tuple[Matrix, ...], Vector]]:
        """Matrices near the given ones with smaller errors of the equations, and the multipliers of the region."""
        second = self.center.ball[1]
        missing = target - self._products(matrices) - second.T @ pull
        weight = float(np.linalg.norm(pull)) + LEAST_PULL
        mending = Mending(matrices, [group.coefficients for group in self.center.groups])
        for found, step in mending.steps(missing, weight * second.T, LARGEST_STEP):
            yield found, pull + weight * step


PARAMETER_BOUND = 1e3
"""The bounds hold for all robots whose parameters are below this many times their units. Where the data hardly shows a
moment of inertia, the least residual of all robots may lie at 1e5 kg m², or nowhere."""

ROOM = 1e-7
"""Part of the objective that a bound may lose by adding multiples of D⁻¹, so that mending can change multipliers that
are zero. It is a tenth of the gap that counts as optimal."""

CONVEX_STEPS = 6
"""Largest number of mending steps for a bound of the objective of a fit. One suffices for 100 random fits (gaps up to
8.0e-7 instead of 7.6e-7); robots that are harder to fit need more."""

DEARNESSES = (1e-4, 1e-2, 1.0)
"""Units of steps in w, relative to a change of X by 1, that are tried: a step in w costs its square, a change of X
hardly anything. With 1 alone, one of 100 random fits ends above the gap, and bounds are off by up to 1e-3 where joints
hardly move."""

FREEDOM = 1e3
"""Unit of steps in the multipliers of equations, which do not change the bound and are therefore preferred."""


@dataclass(frozen=True, eq=False)
class Multipliers:
    """A dual point, in SI units.

    Attributes
    ----------
    blocks : (rows,)
        Z, stacked like the blocks of the set.
    rows : (k,)
        Of the further inequalities.
    """

    blocks: Vector = field(repr=False)
    rows: Vector = field(repr=False)


@dataclass(frozen=True, eq=False)
class ConvexProblem:
    """A convex function over a feasible set, expanded around a point δ°, for lower bounds of its minimum.

    With d = δ - δ° = directions x the function is at least value + gradient · d + ‖root d‖². By weak duality, all
    multipliers Z ⪰ 0 and μ ≥ 0, and all w, give a lower bound for every δ of the set:

        value - ‖w‖² - <Z, D(δ°)> - μ · slack - Σ span_j |g_j|,

    where g = directionsᵀ (gradient + 2 rootᵀ w - Σ Dᵢ·Z - rowsᵀ μ - Eᵀ λ) vanishes but for rounding once the
    multipliers are mended, and |x_j| ≤ span_j holds for all robots whose parameters are within `PARAMETER_BOUND`.
    The accuracy that a solver claims does not enter.

    Attributes
    ----------
    point : (n,)
        δ°; it need not be feasible.
    directions : (n, m)
    units : (m,)
        Typical sizes of x.
    gradient : (n,)
    root : (r, n)
    rows : (k, n)
        Gradients of concave functions of δ that must not be negative.
    slack : (k,)
        The values of these functions at δ°.
    size : float
        Unit of the function's values.
    entropy : float
        The function contains this times -Σ log det P over the pseudo-inertias of the links, which gradient and root
        leave out. -log det P is the maximum of 4 + log det Y - <Y, P> over Y ≻ 0, so that Y acts as a multiplier.
    """

    feasible_set: FeasibleSet = field(repr=False)
    point: Vector = field(repr=False)
    directions: Matrix = field(repr=False)
    units: Vector = field(repr=False)
    value: float
    gradient: Vector = field(repr=False)
    root: Matrix = field(repr=False)
    rows: Matrix = field(repr=False)
    slack: Vector = field(repr=False)
    size: float
    entropy: float = 0.0

    @cached_property
    def _conditions(self) -> tuple[Matrix, Vector]:
        """Σ Dᵢ·Z is the transpose of the first times Z; D(δ°)."""
        stack: AffineStack = self.feasible_set.stack
        coefficients = (stack.coefficients @ self.directions) * self.units
        return np.asarray(coefficients), np.asarray(stack.constant + stack.coefficients @ self.point)

    @cached_property
    def _groups(self) -> list[npt.NDArray[np.intp]]:
        """Rows of the stacked blocks of each size, (blocks, rows)."""
        scalars = np.arange(self.feasible_set.stack.scalar_count)[:, None]
        return [rows for rows in (scalars, *self.feasible_set.stack.rows_by_size.values()) if len(rows)]

    def lower_bound(self, multipliers: Multipliers, enough: float = -np.inf) -> float:
        """The greatest lower bound from the multipliers and their mended forms; -inf if they are not finite.

        Parameters
        ----------
        multipliers : Multipliers
            As the solver returned them.
        enough : float
            Mending ends once the bound is at least this.
        """
        Z, mu = multipliers.blocks / self.size, np.maximum(multipliers.rows / self.size, 0.0)
        if not (np.all(np.isfinite(Z)) and np.all(np.isfinite(mu)) and np.isfinite(self.value)):
            return -np.inf
        best = -np.inf
        if self.entropy:
            bodies = self._bodies
            inverses = np.asarray(np.linalg.inv(self._matrices(bodies)), dtype=float)
            Z[bodies] += self.entropy / self.size * symmetric_to_vector(inverses)
        for start in (self._positive(Z), self._positive(Z + self._inner)):
            state = _State(start, mu, np.zeros(len(self.root)), np.zeros(len(self.feasible_set.equation_values)))
            for _ in range(CONVEX_STEPS):
                cost, state = self._best_mended(state, (self.value - enough) / self.size)
                gain, best = self.value - self.size * cost - best, max(best, self.value - self.size * cost)
                if best >= enough:
                    return best
                if gain < 1e-9 * self.size:
                    break
        return best

    def _best_mended(self, state: "_State", enough: float) -> "tuple[float, _State]":
        """The mended multipliers of the least cost, and it; of one dearness after the other until it is low enough."""
        best, mended = (self._cost(state), state), self._mended(state)
        while not best[0] <= enough < np.inf and (found := next(mended, None)) is not None:
            best = min([best, *((self._cost(one), one) for one in found)], key=lambda pair: pair[0])
        return best

    @cached_property
    def _inner(self) -> Vector:
        """φ D(δ°)⁻¹, stacked: it lowers the bound by `ROOM`, and lets mending change Z wherever D is positive."""
        _, values = self._conditions
        found, order = np.zeros_like(values), max(float(self.feasible_set.stack.identity.sum()), 1.0)
        for rows in self._groups:
            eigenvalues, vectors = np.linalg.eigh(vector_to_symmetric(values[rows]))
            largest = eigenvalues[:, -1:]
            inside = eigenvalues > 1e-12 * np.where(largest > 0, largest, 1.0)
            inverse = np.where(inside, 1.0 / np.where(inside, eigenvalues, 1.0), 0.0)
            found[rows] = symmetric_to_vector(np.einsum("bij,bj,bkj->bik", vectors, inverse, vectors))
        return np.asarray(ROOM / order * found)

    @cached_property
    def _scaled(self) -> tuple[Vector, Matrix, Matrix, Matrix]:
        """Gradient, root, rows and equations over x in its units, for values in units of the size."""
        over = self.directions * self.units
        return (
            self.gradient @ over / self.size,
            self.root @ over / np.sqrt(self.size),
            self.rows @ over,
            self.feasible_set.equation_matrix @ over,
        )

    def _missing(self, state: "_State") -> Vector:
        """g, which vanishes for exact multipliers."""
        gradient, root, rows, equations = self._scaled
        coefficients, _ = self._conditions
        found = gradient + 2.0 * (root.T @ state.w) - coefficients.T @ state.Z - rows.T @ state.mu
        return np.asarray(found - equations.T @ state.equations)

    def _cost(self, state: "_State") -> float:
        """Distance of the bound below the value, in units of the size."""
        _, values = self._conditions
        gap = float(state.w @ state.w + state.Z @ values + state.mu @ self.slack)
        if self.entropy:
            gap += self._excess_of_entropy(state.Z)
        left = self._missing(state)
        error = float(np.abs(state.Z) @ np.abs(values)) + abs(self.value) / self.size
        return gap + float(self._spans @ np.abs(left)) + 16 * EPSILON * error

    @cached_property
    def _spans(self) -> Vector:
        """Largest distance of a robot within `PARAMETER_BOUND` from the point, in units."""
        away = np.abs(self.point) / self.units if len(self.point) == len(self.units) else 0.0
        return 2.0 * PARAMETER_BOUND + away * np.ones(len(self.units))

    @cached_property
    def _bodies(self) -> npt.NDArray[np.intp]:
        """Rows of the stacked blocks of links, (links, 10)."""
        stack = self.feasible_set.stack
        links = [rows for block, rows in zip(stack.blocks, stack.slices, strict=True) if block.kind == "link"]
        return np.array([np.arange(rows.start, rows.stop) for rows in links])

    def _matrices(self, rows: npt.NDArray[np.intp]) -> Matrix:
        """Blocks at δ°."""
        return vector_to_symmetric(self._conditions[1][rows])

    def _excess_of_entropy(self, Z: Vector) -> float:
        """Loss of the bound of -Σ log det P(δ°) by Y = Z / entropy, beyond <Z, P>."""
        weight, matrices = self.entropy / self.size, self._matrices(self._bodies)
        signs, logarithms = np.linalg.slogdet(vector_to_symmetric(Z[self._bodies]) / weight)
        if np.any(signs <= 0):
            return np.inf
        return -weight * float(np.sum(4.0 + logarithms + np.linalg.slogdet(matrices)[1]))

    def _positive(self, Z: Vector) -> Vector:
        """The nearest semidefinite matrices."""
        return self._stacked([positive(vector_to_symmetric(Z[rows])) for rows in self._groups])

    def _stacked(self, matrices: Sequence[Matrix]) -> Vector:
        """Matrices of each group as one vector."""
        found = np.empty(len(self._conditions[1]))
        for rows, group in zip(self._groups, matrices, strict=True):
            found[rows] = symmetric_to_vector(group)
        return found

    def _mended(self, state: "_State") -> "Iterator[list[_State]]":
        """Multipliers near the given ones with a smaller g, those of each dearness together."""
        _, root, inequalities, equations = self._scaled
        coefficients, _ = self._conditions
        mending = Mending(
            [vector_to_symmetric(state.Z[rows]) for rows in self._groups],
            [vector_to_symmetric(np.moveaxis(coefficients[rows], 2, 1)) for rows in self._groups],
        )
        missing = self._missing(replace(state, w=np.zeros(len(root))))
        places = np.cumsum([len(root), len(state.mu)])
        for dearness in DEARNESSES:
            further = np.hstack([-2.0 * dearness * root.T, inequalities.T * state.mu, FREEDOM * equations.T])
            found = []
            for matrices, step in mending.steps(missing, further):
                w, mu, multipliers = np.split(step, places)
                found.append(
                    _State(
                        self._stacked(matrices),
                        np.maximum(state.mu * (1.0 + mu), 0.0),
                        dearness * w,
                        state.equations + FREEDOM * multipliers,
                    )
                )
            yield found


@dataclass(frozen=True, eq=False)
class _State:
    """Multipliers in units of the size."""

    Z: Vector
    mu: Vector
    w: Vector
    equations: Vector
