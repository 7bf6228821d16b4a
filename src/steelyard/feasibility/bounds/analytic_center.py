"""The middle of a section, and the units in which the section is round.

The analytic centre minimises -Σ log det D_b, with a bound on the sum of the traces, since the section may go on
without end. In the metric of that function's Hessian the section contains the unit ball around the centre, and what
it holds below the bound lies within a ball whose radius is the number of rows of all blocks (Nesterov and
Nemirovskii, 1994). So links of 50 g beside links of 50 kg are all of size 1.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .slice import BlockGroup, Section

__all__ = ["Middle", "middle_of"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

TRACE_FACTOR = 10.0
"""The bound on the sum of the traces while the centre is looked for, relative to that of the starting point."""

STEPS = 200

CLOSE_ENOUGH = 1e-2
"""Newton decrement at which the centre is found."""


@dataclass(frozen=True, eq=False)
class Middle:
    """A section in units of its own: w = centre + units v; every block is L (1 + Σ v_j B_j) Lᵀ.

    Attributes
    ----------
    section : Section
    centre : (q,)
    units : (q, q)
    factors : tuple of (b, d, d)
        Inverses of L, of the blocks of each group.
    groups : tuple of BlockGroup
        1 + Σ v_j B_j, of each group.
    size : float
        The bound on the sum of the traces for which this is the middle.
    """

    section: Section = field(repr=False)
    centre: Vector = field(repr=False)
    units: Matrix = field(repr=False)
    factors: tuple[Matrix, ...] = field(repr=False)
    groups: tuple[BlockGroup, ...] = field(repr=False)
    size: float

    @cached_property
    def parameters(self) -> Vector:
        """δ in the middle."""
        return self.section.parameters(self.centre)

    @cached_property
    def directions(self) -> Matrix:
        """δ changes by directions v, (n, q)."""
        return np.asarray(self.section.directions @ self.section.bounded_basis @ self.units)

    @cached_property
    def ball(self) -> tuple[Vector, Matrix]:
        """u = first + second v; ‖u‖ ≤ 1."""
        k = self.section.region.shape[1]
        return self.centre[:k], self.units[:k]


def middle_of(section: Section, start: Vector) -> Middle:
    """Find the middle of a section, from any point inside it.

    Parameters
    ----------
    section : Section
    start : (q,)
        w, strictly inside.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the start is not inside.
    """
    row = section.feasible.trace_row
    along = (row @ section.directions) @ section.bounded_basis
    offset = float(row @ section.reference)
    bound = TRACE_FACTOR * max(offset + float(along @ start), 1e-9)
    k, centre = section.region.shape[1], start
    for _ in range(STEPS):
        gradient, hessian, factors = _derivatives(section, centre, k)
        rest = bound - offset - float(along @ centre)
        gradient = gradient + along / rest
        hessian = hessian + np.outer(along, along) / rest**2
        root = _root(hessian)
        half = np.linalg.solve(root, -gradient)
        if np.linalg.norm(half) < CLOSE_ENOUGH:
            break
        step = np.linalg.solve(root.T, half)
        centre = centre + _length(section, factors, centre[:k], step, k, float(along @ step) / rest) * step
    gradient, hessian, factors = _derivatives(section, centre, k)
    rest = bound - offset - float(along @ centre)
    units = np.asarray(np.linalg.inv(_root(hessian + np.outer(along, along) / rest**2)).T, dtype=float)
    groups = []
    for group, inverse in zip(section.groups, factors, strict=True):
        turned = _congruent(inverse, group.coefficients)
        coefficients = np.einsum("qr,bqij->brij", units, turned)
        unit = np.broadcast_to(np.eye(group.size), group.constants.shape)
        groups.append(BlockGroup(group.size, group.indices, unit, coefficients))
    return Middle(section, centre, units, factors, tuple(groups), bound)


def _congruent(inverse: Matrix, matrices: Matrix) -> Matrix:
    """L⁻¹ A L⁻ᵀ, of every block (b, d, d) and every matrix (b, q, d, d)."""
    return np.asarray(np.einsum("bik,bqkl,bjl->bqij", inverse, matrices, inverse, optimize=True))


def _root(hessian: Matrix) -> Matrix:
    """Cholesky factor, of a Hessian whose unknowns may have very different units."""
    scale = 1.0 / np.sqrt(np.diagonal(hessian))
    scaled = hessian * np.outer(scale, scale)
    root = np.linalg.cholesky(scaled + 1e-14 * np.eye(len(scaled)))
    return np.asarray(root / scale[:, None], dtype=float)


def _derivatives(section: Section, point: Vector, k: int) -> tuple[Vector, Matrix, tuple[Matrix, ...]]:
    """Gradient and Hessian of -Σ log det D_b - log(1 - ‖u‖²), and L⁻¹ of the blocks of each group."""
    count = len(point)
    gradient, hessian, factors = np.zeros(count), np.zeros((count, count)), []
    for group in section.groups:
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


def _length(section: Section, factors: tuple[Matrix, ...], u: Vector, step: Vector, k: int, trace_rate: float) -> float:
    """The length t along a step that minimises the barrier: its derivative has one zero before the boundary."""
    rates = [-np.array([trace_rate])]
    for group, inverse in zip(section.groups, factors, strict=True):
        changes = group.change(step)
        rates.append(np.linalg.eigvalsh(inverse @ changes @ inverse.transpose(0, 2, 1)).ravel())
    if k:
        # 1 - ‖u + t s‖² = (1 - ‖u‖²) (1 + t r₁) (1 + t r₂)
        s = step[:k]
        rest = 1.0 - float(u @ u)
        half = -float(u @ s) / rest
        root = np.sqrt(half**2 + float(s @ s) / rest)
        rates.append(np.array([half + root, half - root]))
    rate = np.concatenate(rates)
    lowest = float(rate.min())
    low, high = 0.0, (1.0 / -lowest if lowest < 0 else 1e6)
    for _ in range(40):
        middle = 0.5 * (low + high)
        slope = -float(np.sum(rate / (1.0 + middle * rate)))
        low, high = (middle, high) if slope < 0 else (low, middle)
    return low
