"""Nonlinear conditions on the inertial parameters of all links at once, with their derivatives.

A link's parameters are ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``, its inertia about the centre of mass is
I = L - (|l|² 1 - l lᵀ) / m (thesis 2.16). With `triangle` the same is asked of the second moments about the centre of
mass, ½ tr(I) 1 - I, which are positive definite where the triangle inequality holds too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

__all__ = ["Diagonals", "Eigenvalues", "LinkConditions", "SylvesterMinors", "inertia_about_com"]

Array = npt.NDArray[Any]

ROWS, COLUMNS = np.triu_indices(3)
TWICE = np.where(ROWS == COLUMNS, 1.0, 2.0)  # off-diagonal elements stand for two
PLACES = np.zeros((3, 3), dtype=np.intp)
PLACES[ROWS, COLUMNS] = PLACES[COLUMNS, ROWS] = np.arange(6)
EYE = np.eye(3)
COMPLEX_STEP = 1e-30  # its square vanishes beside 1, so that the derivative is exact to rounding
NEAR = 1e-3
"""Eigenvalues closer than this part of the trace count as that far apart in second derivatives."""


class LinkConditions(Protocol):
    """Functions of each link's parameters that must not be negative."""

    @property
    def count(self) -> int:
        """Number c of functions for each link."""

    def values(self, inertial: Array) -> Array:
        """Of (links, 10), (links, c)."""

    def jacobian(self, inertial: Array) -> Array:
        """First derivatives, (links, c, 10)."""

    def curvature(self, inertial: Array, multipliers: Array) -> Array:
        """Second derivatives, summed with multipliers (links, c), (links, 10, 10)."""


def _matrix(six: Array) -> Array:
    """Symmetric (..., 3, 3) of (..., 6)."""
    return np.asarray(six[..., PLACES])


def _six(matrix: Array) -> Array:
    """Derivative by (..., 6) from that by a symmetric matrix (..., 3, 3)."""
    return np.asarray(matrix[..., ROWS, COLUMNS] * TWICE)


def _trace(matrix: Array) -> Array:
    return np.asarray(np.trace(matrix, axis1=-2, axis2=-1))[..., None, None]


def _inner(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...ij,...ij->...", a, b))


def _complement(matrix: Array) -> Array:
    """tr(A) 1 - A."""
    return np.asarray(_trace(matrix) * EYE - matrix)


def _second_moments(matrix: Array) -> Array:
    """½ tr(A) 1 - A; this map is symmetric, so it also carries derivatives back."""
    return np.asarray(0.5 * _trace(matrix) * EYE - matrix)


def inertia_about_com(inertial: Array) -> Array:
    """I of thesis 2.16, (links, 3, 3), of (links, 10)."""
    first, mass = inertial[..., 6:9], inertial[..., 9]
    return np.asarray(_matrix(inertial[..., :6]) - _complement(_outer(first)) / mass[..., None, None])


def _outer(vector: Array) -> Array:
    return np.asarray(vector[..., :, None] * vector[..., None, :])


def _slopes(inertial: Array, G: Array) -> Array:
    """First derivatives of <G, I> for matrices G (links, c, 3, 3) held constant, (links, c, 10)."""
    first, mass = inertial[:, 6:9], inertial[:, 9]
    B = _complement(G)
    by_first = -2.0 * np.einsum("kcij,kj->kci", B, first) / mass[:, None, None]
    by_mass = -0.5 * np.einsum("kci,ki->kc", by_first, first) / mass[:, None]
    return np.concatenate([_six(G), by_first, by_mass[..., None]], axis=-1)


def _bends(inertial: Array, G: Array) -> Array:
    """Second derivatives of <G, I> for one matrix G of each link (links, 3, 3), (links, 10, 10)."""
    first, mass = inertial[:, 6:9], inertial[:, 9, None, None]
    B = _complement(G)
    Bl = np.einsum("kij,kj->ki", B, first)
    found = np.zeros((len(inertial), 10, 10))
    found[:, 6:9, 6:9] = -2.0 * B / mass
    found[:, 6:9, 9] = found[:, 9, 6:9] = 2.0 * Bl / mass[:, 0] ** 2
    found[:, 9, 9] = -2.0 * np.einsum("ki,ki->k", first, Bl) / mass[:, 0, 0] ** 3
    return found


@dataclass(frozen=True)
class Diagonals:
    """The diagonal of the inertia about the centre of mass: necessary, not sufficient."""

    triangle: bool = False
    count: int = 3

    def values(self, inertial: Array) -> Array:
        """Of (links, 10), (links, 3)."""
        return np.asarray(np.einsum("kii->ki", self._tensor(inertial)))

    def jacobian(self, inertial: Array) -> Array:
        """First derivatives, (links, 3, 10)."""
        return _slopes(inertial, np.broadcast_to(self._weights, (len(inertial), 3, 3, 3)))

    def curvature(self, inertial: Array, multipliers: Array) -> Array:
        """Second derivatives, summed with multipliers (links, 3), (links, 10, 10)."""
        return _bends(inertial, np.einsum("kc,cij->kij", multipliers, self._weights))

    def _tensor(self, inertial: Array) -> Array:
        tensor = inertia_about_com(inertial)
        return _second_moments(tensor) if self.triangle else tensor

    @property
    def _weights(self) -> Array:
        single = np.einsum("ci,cj->cij", EYE, EYE)
        return _second_moments(single) if self.triangle else single


@dataclass(frozen=True)
class Eigenvalues:
    """The three eigenvalues of the inertia about the centre of mass, in ascending order.

    They have no derivative where two of them meet; what is returned there belongs to one choice of eigenvectors.
    """

    triangle: bool = False
    count: int = 3

    def values(self, inertial: Array) -> Array:
        """Of (links, 10), (links, 3)."""
        return np.asarray(np.linalg.eigvalsh(self._tensor(inertial)))

    def jacobian(self, inertial: Array) -> Array:
        """First derivatives, (links, 3, 10)."""
        vectors = np.linalg.eigh(self._tensor(inertial))[1]
        return _slopes(inertial, self._pull(np.einsum("kic,kjc->kcij", vectors, vectors)))

    def curvature(self, inertial: Array, multipliers: Array) -> Array:
        """Second derivatives, summed with multipliers (links, 3), (links, 10, 10)."""
        values, vectors = np.linalg.eigh(self._tensor(inertial))
        weighted = np.einsum("kc,kic,kjc->kij", multipliers, vectors, vectors)
        found = _bends(inertial, self._pull(weighted))
        least = NEAR * np.abs(values).sum(axis=1)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            mixed = np.einsum("ki,kj->kij", vectors[:, :, i], vectors[:, :, j])
            mixed = self._pull(0.5 * (mixed + mixed.swapaxes(1, 2)))
            slope = _slopes(inertial, mixed[:, None])[:, 0]
            gap = np.maximum(values[:, j] - values[:, i], least)
            factor = 2.0 * (multipliers[:, j] - multipliers[:, i]) / np.where(gap > 0.0, gap, 1.0)
            found += factor[:, None, None] * _outer(slope)
        return found

    def _tensor(self, inertial: Array) -> Array:
        tensor = inertia_about_com(inertial)
        return _second_moments(tensor) if self.triangle else tensor

    def _pull(self, G: Array) -> Array:
        return _second_moments(G) if self.triangle else G


def _adjugates(a: Array, b: Array) -> Array:
    """The symmetric bilinear map X with X(A, A) = 2 adj(A); <A, X(B, C)> is symmetric in all three."""
    ab = a @ b
    trace_a, trace_b = _trace(a), _trace(b)
    return np.asarray(
        ab + ab.swapaxes(-1, -2) - trace_a * b - trace_b * a + (trace_a * trace_b - _inner(a, b)[..., None, None]) * EYE
    )


@dataclass(frozen=True)
class SylvesterMinors:
    """The leading principal minors of the inertia about the centre of mass, times m² (thesis 3.1 to 3.5).

    With S = |l|² 1 - l lᵀ and A = m L - S = m I they are the polynomials P1 = m A11, P2 = A11 A22 - A12² and
    P3 = det(A) / m = m² det(L) - m tr(adj(L) S) + tr(L adj(S)), the last because det(S) = 0.
    """

    triangle: bool = False
    count: int = 3

    def values(self, inertial: Array) -> Array:
        """Of (links, 10), (links, 3)."""
        mass, L, S = self._parts(inertial)
        A = mass[:, None, None] * L - S
        adjugate = 0.5 * _adjugates(L, L)
        third = mass**2 * _inner(adjugate, L) / 3.0 - mass * _inner(adjugate, S) + 0.5 * _inner(L, _adjugates(S, S))
        return np.stack([mass * A[:, 0, 0], A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] ** 2, third], axis=-1)

    def jacobian(self, inertial: Array) -> Array:
        """First derivatives, (links, 3, 10)."""
        mass, L, S = self._parts(inertial)
        m = mass[:, None, None]
        A = m * L - S
        corner = np.zeros_like(A)
        corner[:, 0, 0] = 1.0
        block = np.zeros_like(A)
        block[:, 0, 0], block[:, 1, 1] = A[:, 1, 1], A[:, 0, 0]
        block[:, 0, 1] = block[:, 1, 0] = -A[:, 0, 1]
        adjugate, mixed, other = 0.5 * _adjugates(L, L), _adjugates(L, S), 0.5 * _adjugates(S, S)
        by_L = np.stack([m**2 * corner, m * block, m**2 * adjugate - m * mixed + other], axis=1)
        by_S = np.stack([-m * corner, -block, mixed - m * adjugate], axis=1)
        by_mass = np.stack(
            [
                2.0 * mass * L[:, 0, 0] - S[:, 0, 0],
                _inner(block, L),
                2.0 * mass * _inner(adjugate, L) / 3.0 - _inner(adjugate, S),
            ],
            axis=-1,
        )
        first = inertial[:, 6:9]
        by_first = 2.0 * np.einsum("kcij,kj->kci", by_S if self.triangle else _complement(by_S), first)
        by_six = _six(_second_moments(by_L) if self.triangle else by_L)
        return np.concatenate([by_six, by_first, by_mass[..., None]], axis=-1)

    def curvature(self, inertial: Array, multipliers: Array) -> Array:
        """Second derivatives, summed with multipliers (links, 3), (links, 10, 10).

        By complex steps of the first: the minors are polynomials, so that this is exact to rounding.
        """
        count = len(inertial)
        steps = inertial[None] + 1j * COMPLEX_STEP * np.eye(10)[:, None]
        slopes = self.jacobian(steps.reshape(-1, 10)).reshape(10, count, 3, 10)
        return np.asarray(np.einsum("ikcj,kc->kij", slopes.imag, multipliers) / COMPLEX_STEP)

    def _parts(self, inertial: Array) -> tuple[Array, Array, Array]:
        """Mass, L and S; with the triangle inequality second moments instead of L, and S = l lᵀ."""
        L, S = _matrix(inertial[:, :6]), _outer(inertial[:, 6:9])
        if self.triangle:
            return inertial[:, 9], _second_moments(L), S
        return inertial[:, 9], L, _complement(S)
