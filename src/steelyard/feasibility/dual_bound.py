"""From a solver's dual point, whose equations hold to its accuracy, to a bound that holds whatever the solver did.

Weak duality turns every dual point whose equations hold into a bound. `Mending` makes them hold to rounding, and what
rounding leaves counts against the bound, for robots up to a size. It serves the bounds of single quantities
(`SliceBound`) and those of what a fit minimises (`ConvexProblem`). Proofs that hold without any restriction are exact
dual points, in `checking.exact_dual_point`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from steelyard.lmi import AffineStack, symmetric_to_vector, vector_to_symmetric

from .bounds.analytic_center import AnalyticCenter
from .feasible_set import FeasibleSet

__all__ = ["EPSILON", "PARAMETER_BOUND", "ConvexProblem", "Mending", "Multipliers", "SliceBound"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

DAMPINGS = (1e-14, 1e-12, 1e-9, 1e-6, 1e-4)
"""Parts of the largest singular value below which mending leaves things as they are; the best one is taken."""

EPSILON = float(np.finfo(float).eps)


class Mending:
    """Newton steps after which the equations Σ <B_j, Z_b> + further_j · p = target_j of a dual point hold better.

    Z becomes Z^½ (1 + X) Z^½, with X and the steps of p as small as can be: what is zero in Z stays zero, and what is
    not stays positive.

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
        """Mended matrices, and steps of what else stands in the equations, one for each damping.

        Parameters
        ----------
        missing : (m,)
            By how much the equations fail.
        further : (m, k)
            Coefficients of the other unknowns, in units of what their steps may cost.
        most : float
            Steps that change an element of X, or another unknown in its unit, by more are left out.
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
    """Symmetric matrices with a function of their eigenvalues, which count as zero where they are negative."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray(np.einsum("bij,bj,bkj->bik", vectors, function(np.maximum(values, 0.0)), vectors))


TRACE_BOUND_FACTOR = 1e2
"""The bounds hold for robots up to this many times as large as the one at the center was allowed to be."""

SLICE_STEPS = 4
"""Most steps of mending a bound of one quantity."""

LARGEST_STEP = 0.5
"""Larger steps, and a damping of 1e-3, find other dual points than the solver's, and with them bounds for robots up to
the trace bound alone: the centre of mass of a link that may be massless came out as bounded by 1e5 m."""

LEAST_PULL = 1e-6
"""What a mending step may change in the pull at u where there is none."""


class SliceBound:
    """Lower bounds of combinations c·δ over a slice, from dual matrices.

    In the coordinates v of the center, c·v ≥ -Σ tr Z_b + g·v with g_j = c_j - Σ <B_j, Z_b>, for any Z ⪰ 0. Within the
    region g·v has a least value; along the free directions g vanishes to rounding, and what is left of it counts with
    the trace bound.

    Parameters
    ----------
    center : AnalyticCenter
    """

    def __init__(self, center: AnalyticCenter) -> None:
        self.center = center
        count = len(center.point)
        second = center.ball[1]
        # Directions of v that leave u where it is.
        still = np.linalg.svd(second)[2][np.linalg.matrix_rank(second) :] if len(second) else np.eye(count)
        self._still = still.T
        self._to_pull = np.linalg.pinv(second.T)
        order = sum(group.size * len(group.indices) for group in center.groups)
        self._radius = 4.0 * TRACE_BOUND_FACTOR * (order + 2.0)

    @property
    def trace_bound(self) -> float:
        """The bounds hold where the traces of all blocks (kg, kg m², ...) add to less than this."""
        return TRACE_BOUND_FACTOR * self.center.size

    def of(self, row: Vector, duals: tuple[Matrix, ...], pull: Vector) -> float:
        """The lower bound of row · δ, rounded down; -inf where the matrices are no numbers.

        Parameters
        ----------
        row : (n,)
        duals : tuple of (b, d, d)
            Z of each group, in the units of the center, for the objective scaled to length 1.
        pull : (k,)
            The dual of the region: Σ <B_j, Z_b> plus what it gives along v_j is c_j, to the solver's accuracy.
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
        """The bound that matrices prove, as it is."""
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
        """Matrices near the given ones whose equations hold better, and the pull that goes with them."""
        second = self.center.ball[1]
        missing = target - self._products(matrices) - second.T @ pull
        weight = float(np.linalg.norm(pull)) + LEAST_PULL
        mending = Mending(matrices, [group.coefficients for group in self.center.groups])
        for found, step in mending.steps(missing, weight * second.T, LARGEST_STEP):
            yield found, pull + weight * step


PARAMETER_BOUND = 1e3
"""The bounds hold for all robots whose parameters are below this many times their units."""

ROOM = 1e-7
"""Part of the size that a bound may lose so that multipliers keep away from zero."""

CONVEX_STEPS = 6
"""Most steps of mending a bound of what a fit minimises."""

DEARNESSES = (1e-4, 1e-2, 1.0)
"""What mending may take of w, beside a relative change of the matrices of 1: w has a price, that change nearly none."""

FREEDOM = 1e3
"""Multipliers of equations cost nothing, so that mending prefers them by this factor."""


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
    """Minimise a convex function over a feasible set, as it looks from a point δ°.

    With d = δ - δ° = directions x the function is at least value + gradient · d + ‖root d‖². Every multiplier Z ⪰ 0,
    μ ≥ 0, and every w, turn that into a lower bound for all δ of the set (weak duality):

        value - ‖w‖² - <Z, D(δ°)> - μ · slack - Σ span_j |g_j|,

    where g = directionsᵀ (gradient + 2 rootᵀ w - Σ Dᵢ·Z - rowsᵀ μ - Eᵀ λ) vanishes but for rounding once the
    multipliers are mended, and |x_j| ≤ span_j holds for all robots whose parameters are within `PARAMETER_BOUND`.
    Nothing that a solver says of itself enters.

    Attributes
    ----------
    feasible_set : FeasibleSet
    point : (n,)
        δ°; it need not be feasible.
    directions : (n, m)
    units : (m,)
        Sizes that are typical of x.
    value : float
    gradient : (n,)
    root : (r, n)
    rows : (k, n)
        Gradients of concave functions of δ that must not be negative.
    slack : (k,)
        Their values at δ°.
    size : float
        Unit of the function's values.
    entropy : float
        The function holds this times -Σ log det P over the pseudo-inertias of the links, which gradient and root leave
        out. -log det P is the greatest 4 + log det Y - <Y, P> over Y ≻ 0, so that such matrices stand for multipliers.
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
        return [rows for rows in (scalars, *self.feasible_set.stack._rows_by_size.values()) if len(rows)]

    def lower_bound(self, multipliers: Multipliers, enough: float = -np.inf) -> float:
        """The greatest lower bound that the multipliers give once they are mended; -inf where they are no numbers.

        Parameters
        ----------
        multipliers : Multipliers
            As a solver left them.
        enough : float
            Mending ends at a bound that is as good.
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
                cost, _, state = min((self._cost(s), k, s) for k, s in enumerate(self._mended(state)))
                gain, best = self.value - self.size * cost - best, max(best, self.value - self.size * cost)
                if best >= enough:
                    return best
                if gain < 1e-9 * self.size:
                    break
        return best

    @cached_property
    def _inner(self) -> Vector:
        """φ D(δ°)⁻¹, stacked, which costs `ROOM` and gives mending room wherever the point is not on the boundary."""
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
        """g, which is to vanish."""
        gradient, root, rows, equations = self._scaled
        coefficients, _ = self._conditions
        found = gradient + 2.0 * (root.T @ state.w) - coefficients.T @ state.Z - rows.T @ state.mu
        return np.asarray(found - equations.T @ state.equations)

    def _cost(self, state: "_State") -> float:
        """By how much, in units of the size, the bound lies below the value."""
        _, values = self._conditions
        gap = float(state.w @ state.w + state.Z @ values + state.mu @ self.slack)
        if self.entropy:
            gap += self._excess_of_entropy(state.Z)
        left = self._missing(state)
        error = float(np.abs(state.Z) @ np.abs(values)) + abs(self.value) / self.size
        return gap + float(self._spans @ np.abs(left)) + 16 * EPSILON * error

    @cached_property
    def _spans(self) -> Vector:
        """How far a robot within that bound can be from the point, in units; twice that, for sums of two bounds."""
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
        """What Y = Z / entropy loses of -Σ log det P(δ°), beyond what <Z, P> already counts."""
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

    def _mended(self, state: "_State") -> "Iterator[_State]":
        """Multipliers near the given ones for which g is smaller."""
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
            for matrices, step in mending.steps(missing, further):
                w, mu, multipliers = np.split(step, places)
                yield _State(
                    self._stacked(matrices),
                    np.maximum(state.mu * (1.0 + mu), 0.0),
                    dearness * w,
                    state.equations + FREEDOM * multipliers,
                )
        yield state


@dataclass(frozen=True, eq=False)
class _State:
    """Multipliers in units of the size."""

    Z: Vector
    mu: Vector
    w: Vector
    equations: Vector
