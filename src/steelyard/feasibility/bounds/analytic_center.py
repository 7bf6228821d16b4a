"""The analytic center of a slice, and the units in which the slice is round.

The analytic center minimises -Σ log det D_b, with a bound on the sum of the traces, since the slice may go on
without bound. In the metric of that function's Hessian the slice contains the unit ball around the center, and what
it holds below the bound lies within a ball whose radius is the number of rows of all blocks (Nesterov and
Nemirovskii, 1994). So links of 50 g beside links of 50 kg are all of size 1.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.once import cached_property

from ..dual_center import line_minimum
from .slice import BlockGroup, Slice

__all__ = ["AnalyticCenter", "analytic_center"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

TRACE_FACTOR = 10.0
"""Bound on the sum of the traces while the center is searched for, relative to that of the starting point, which is a
robot of moderate size."""

STEPS = 200
"""Largest number of Newton steps; damped steps of a self-concordant function need some tens."""

CLOSE_ENOUGH = 1e-2
"""Newton decrement at which the search ends. The center only provides units, so that a rough one is good enough."""


@dataclass(frozen=True, eq=False)
class AnalyticCenter:
    """A slice in units of its own: w = point + units v; every block is L (1 + Σ v_j B_j) Lᵀ.

    Attributes
    ----------
    point : (q,)
    units : (q, q)
    factors : tuple of (b, d, d)
        Inverses of L, of the blocks of each group.
    groups : tuple of BlockGroup
        1 + Σ v_j B_j, of each group.
    size : float
        The bound on the sum of the traces for which this is the center.
    """

    slice: Slice = field(repr=False)
    point: Vector = field(repr=False)
    units: Matrix = field(repr=False)
    factors: tuple[Matrix, ...] = field(repr=False)
    groups: tuple[BlockGroup, ...] = field(repr=False)
    size: float

    @cached_property
    def parameters(self) -> Vector:
        """δ at the center."""
        return self.slice.parameters(self.point)

    @cached_property
    def directions(self) -> Matrix:
        """δ changes by directions v, (n, q)."""
        return np.asarray(self.slice.directions @ self.slice.bounded_basis @ self.units)

    @cached_property
    def ball(self) -> tuple[Vector, Matrix]:
        """u = first + second v; ‖u‖ ≤ 1."""
        k = self.slice.region.shape[1]
        return self.point[:k], self.units[:k]


def analytic_center(slice_: Slice, start: Vector) -> AnalyticCenter:
    """Find the analytic center of a slice, from any point inside it.

    Parameters
    ----------
    slice : Slice
    start : (q,)
        w, strictly inside.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the start is not inside.
    """
    row = slice_.feasible_set.trace_row
    along = (row @ slice_.directions) @ slice_.bounded_basis
    offset = float(row @ slice_.reference)
    bound = TRACE_FACTOR * max(offset + float(along @ start), 1e-9)
    k, center = slice_.region.shape[1], start

    def around(point: Vector) -> tuple[Vector, Matrix, tuple[Matrix, ...]]:
        """Gradient and root of the Hessian with the bound of the traces, and L⁻¹ of the blocks."""
        gradient, hessian, factors = _derivatives(slice_, point, k)
        trace = along / (bound - offset - float(along @ point))
        return gradient + trace, _root(hessian + np.outer(trace, trace)), factors

    for _ in range(STEPS):
        gradient, root, factors = around(center)
        half = np.linalg.solve(root, -gradient)
        if np.linalg.norm(half) < CLOSE_ENOUGH:
            break
        step = np.linalg.solve(root.T, half)
        trace_rate = float(along @ step) / (bound - offset - float(along @ center))
        rates = np.append(_rates(slice_, factors, center[:k], step), -trace_rate)
        center = center + line_minimum(0.0, rates, 0.0) * step
    _, root, factors = around(center)
    units = np.asarray(np.linalg.inv(root).T, dtype=float)
    groups = []
    for group, inverse in zip(slice_.groups, factors, strict=True):
        turned = _congruent(inverse, group.coefficients)
        coefficients = np.einsum("qr,bqij->brij", units, turned)
        unit = np.broadcast_to(np.eye(group.size), group.constants.shape)
        groups.append(BlockGroup(group.size, group.indices, unit, coefficients))
    return AnalyticCenter(slice_, center, units, factors, tuple(groups), bound)


def _congruent(inverse: Matrix, matrices: Matrix) -> Matrix:
    """L⁻¹ A L⁻ᵀ, of every block (b, d, d) and every matrix (b, q, d, d)."""
    return np.asarray(np.einsum("bik,bqkl,bjl->bqij", inverse, matrices, inverse, optimize=True))


def _root(hessian: Matrix) -> Matrix:
    """Cholesky factor of a Hessian, which is scaled first since its unknowns may have very different units."""
    scale = 1.0 / np.sqrt(np.diagonal(hessian))
    scaled = hessian * np.outer(scale, scale)
    root = np.linalg.cholesky(scaled + 1e-14 * np.eye(len(scaled)))
    return np.asarray(root / scale[:, None], dtype=float)


def _derivatives(slice_: Slice, point: Vector, k: int) -> tuple[Vector, Matrix, tuple[Matrix, ...]]:
    """Gradient and Hessian of -Σ log det D_b - log(1 - ‖u‖²), and L⁻¹ of the blocks of each group."""
    count = len(point)
    gradient, hessian, factors = np.zeros(count), np.zeros((count, count)), []
    for group in slice_.groups:
        inverse = np.linalg.inv(np.linalg.cholesky(group.evaluate(point)))
        turned = _congruent(inverse, group.coefficients)
        gradient -= np.einsum("bqii->q", turned)
        flat = turned.transpose(1, 0, 2, 3).reshape(count, -1)
        hessian += flat @ flat.T
        factors.append(inverse)
    if k:
        u = point[:k]
        rest = 1.0 - float(u @ u)
        if rest <= 0:
            raise np.linalg.LinAlgError
        gradient[:k] += 2.0 * u / rest
        hessian[:k, :k] += 2.0 * np.eye(k) / rest + 4.0 * np.outer(u, u) / rest**2
    return gradient, hessian, tuple(factors)


def _rates(slice_: Slice, factors: tuple[Matrix, ...], u: Vector, step: Vector) -> Vector:
    """The rates r of a step such that the barrier of blocks and ball is that of its beginning less Σ log(1 + t r)."""
    rates = []
    for group, inverse in zip(slice_.groups, factors, strict=True):
        changes = group.change(step)
        rates.append(np.linalg.eigvalsh(inverse @ changes @ inverse.transpose(0, 2, 1)).ravel())
    if len(u):
        # 1 - ‖u + t s‖² = (1 - ‖u‖²) (1 + t r₁) (1 + t r₂)
        s = step[: len(u)]
        rest = 1.0 - float(u @ u)
        half = -float(u @ s) / rest
        root = np.sqrt(half**2 + float(s @ s) / rest)
        rates.append(np.array([half + root, half - root]))
    return np.concatenate([np.zeros(0), *rates])
