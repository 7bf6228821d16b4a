"""From a solver's dual point, whose equations hold to its accuracy, to a bound that holds whatever the solver did."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.lmi import AffineStack, symmetric_to_vector, vector_to_symmetric

__all__ = ["REACH", "ConvexProblem", "Multipliers"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

REACH = 1e3
"""The bounds hold for all robots whose parameters are below this many times their units."""

ROOM = 1e-7
"""Part of the size that a bound may lose so that multipliers keep away from zero."""

MENDING_STEPS = 6

DAMPINGS = (1e-15, 1e-12, 1e-9, 1e-6, 1e-3)
"""Parts of the largest singular value below which mending leaves things as they are; the best one is taken."""

DEARNESSES = (1e-4, 1e-2, 1.0)
"""What mending may take of w, beside a relative change of the matrices of 1: w has a price, that change nearly none."""

FREEDOM = 1e3
"""Multipliers of equations cost nothing, so that mending prefers them by this factor."""

EPSILON = float(np.finfo(float).eps)


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
    multipliers are mended, and |x_j| ≤ span_j holds for all robots whose parameters are within `REACH`. Nothing that a
    solver says of itself enters.

    Attributes
    ----------
    feasible : FeasibleSet
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

    feasible: FeasibleSet = field(repr=False)
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
        stack: AffineStack = self.feasible.stack
        coefficients = (stack.coefficients @ self.directions) * self.units
        return np.asarray(coefficients), np.asarray(stack.constant + stack.coefficients @ self.point)

    @cached_property
    def _groups(self) -> list[npt.NDArray[np.intp]]:
        """Rows of the stacked blocks of each size, (blocks, rows)."""
        scalars = np.arange(self.feasible.stack.scalar_count)[:, None]
        return [rows for rows in (scalars, *self.feasible.stack._rows_by_size.values()) if len(rows)]

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
            state = _State(start, mu, np.zeros(len(self.root)), np.zeros(len(self.feasible.equation_values)))
            for _ in range(MENDING_STEPS):
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
        found, order = np.zeros_like(values), max(float(self.feasible.stack.identity.sum()), 1.0)
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
            self.feasible.equation_matrix @ over,
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
        """How far a robot within the reach can be from the point, in units; twice the reach, for sums of two bounds."""
        away = np.abs(self.point) / self.units if len(self.point) == len(self.units) else 0.0
        return 2.0 * REACH + away * np.ones(len(self.units))

    @cached_property
    def _bodies(self) -> npt.NDArray[np.intp]:
        """Rows of the stacked blocks of links, (links, 10)."""
        stack = self.feasible.stack
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
        found = np.empty_like(Z)
        for rows in self._groups:
            values, vectors = np.linalg.eigh(vector_to_symmetric(Z[rows]))
            nearest = np.einsum("bij,bj,bkj->bik", vectors, np.maximum(values, 0.0), vectors)
            found[rows] = symmetric_to_vector(nearest)
        return found

    def _mended(self, state: "_State") -> "Iterator[_State]":
        """Multipliers near the given ones for which g is smaller.

        Z^½ (1 + X) Z^½ with X as small as can be: what is zero stays zero, and what is not stays positive.
        """
        _, root, inequalities, equations = self._scaled
        coefficients, _ = self._conditions
        count = len(self.units)
        parts, roots = [], []
        for rows in self._groups:
            values, vectors = np.linalg.eigh(vector_to_symmetric(state.Z[rows]))
            half = np.einsum("bij,bj,bkj->bik", vectors, np.sqrt(np.maximum(values, 0.0)), vectors)
            matrices = vector_to_symmetric(np.moveaxis(coefficients[rows], 2, 1))  # (b, m, d, d)
            product = half[:, None] @ matrices @ half[:, None]
            vector = symmetric_to_vector(product)  # (b, m, rows)
            parts.append(np.moveaxis(vector, 1, 0).reshape(count, -1))
            roots.append(half)
        start = replace(state, w=np.zeros(len(root)))
        missing = self._missing(start)
        for dearness in DEARNESSES:
            system = np.hstack([*parts, -2.0 * dearness * root.T, inequalities.T * state.mu, FREEDOM * equations.T])
            left, values, right = np.linalg.svd(system, full_matrices=False)
            along = left.T @ missing
            largest = float(values.max(initial=0.0)) or 1.0
            for damping in DAMPINGS:
                step = right.T @ (along * values / (values**2 + (damping * largest) ** 2))
                yield self._moved(start, step, roots, dearness)
        yield state

    def _moved(self, state: "_State", step: Vector, roots: list[Matrix], dearness: float) -> "_State":
        """The multipliers after a step of mending."""
        Z, start = state.Z.copy(), 0
        for rows, half in zip(self._groups, roots, strict=True):
            change = vector_to_symmetric(step[start : start + rows.size].reshape(rows.shape))
            start += rows.size
            Z[rows] += symmetric_to_vector(half @ change @ half)
        w, mu, equations = np.split(step[start:], np.cumsum([len(state.w), len(state.mu)]))
        return _State(
            self._positive(Z),
            np.maximum(state.mu * (1.0 + mu), 0.0),
            state.w + dearness * w,
            state.equations + FREEDOM * equations,
        )


@dataclass(frozen=True, eq=False)
class _State:
    """Multipliers in units of the size."""

    Z: Vector
    mu: Vector
    w: Vector
    equations: Vector
