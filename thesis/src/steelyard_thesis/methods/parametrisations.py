"""Maps from free numbers to inertial parameters of all links at once, with first and second derivatives.

A link's parameters are ``Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m``, in units of the link.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from steelyard.robot.inertia import parameters_of_pseudo_inertia, pseudo_inertia

__all__ = ["CholeskyOfBody", "LogCholesky", "Parametrisation"]

Array = npt.NDArray[np.float64]

ROWS, COLUMNS = np.triu_indices(3)
PLACES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
EYE = np.eye(3)


class Parametrisation(Protocol):
    """Ten free numbers θ for each link, and what they mean."""

    def inertial(self, theta: Array) -> Array:
        """Inertial parameters, (links, 10), of θ (links, 10)."""

    def jacobian(self, theta: Array) -> Array:
        """Their derivatives by θ, (links, 10, 10)."""

    def curvature(self, theta: Array, slopes: Array) -> Array:
        """Second derivatives of <slopes, inertial> with slopes (links, 10) held constant, (links, 10, 10)."""

    def theta(self, inertial: Array) -> Array:
        """θ of parameters strictly inside the conditions, (links, 10)."""


def _symmetric(vector: Array) -> Array:
    return np.asarray(vector[..., PLACES])


def _outer_tensor() -> Array:
    """Second derivatives of the six elements of F Fᵀ by the six elements of a lower triangular F, column by column."""
    found = np.zeros((6, 6, 6))
    elements = [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)]
    for a, (i, column) in enumerate(elements):
        for b, (j, other) in enumerate(elements):
            if column == other:
                found[PLACES[i, j], a, b] += 1.0 if i != j else 2.0
    return found


def _complement_of_six() -> Array:
    """The linear map A -> tr(A) 1 - A on six elements, (6, 6)."""
    found = -np.eye(6)
    diagonal = PLACES[np.arange(3), np.arange(3)]
    found[np.ix_(diagonal, diagonal)] += 1.0
    return found


OUTER = _outer_tensor()
COMPLEMENT = _complement_of_six()


@dataclass(frozen=True)
class CholeskyOfBody:
    """θ = (√m, centre of mass, six elements of a Cholesky factor F by columns), thesis 2.70 and 2.71.

    Attributes
    ----------
    second_moments : bool
        F Fᵀ are the second moments about the centre of mass, so that the triangle inequality holds; else the inertia
        about it, as published.
    """

    second_moments: bool = False

    def inertial(self, theta: Array) -> Array:
        """Inertial parameters, (links, 10), of θ (links, 10)."""
        root, center, factor = theta[:, :1], theta[:, 1:4], theta[:, 4:]
        tensor = 0.5 * np.einsum("sab,ka,kb->ks", self._tensor, factor, factor)
        point = np.asarray(root**2 * self._point(center))
        point[:, :6] += tensor
        return point

    def jacobian(self, theta: Array) -> Array:
        """Their derivatives by θ, (links, 10, 10)."""
        root, center, factor = theta[:, :1], theta[:, 1:4], theta[:, 4:]
        found = np.zeros((len(theta), 10, 10))
        found[:, :, 0] = 2.0 * root * self._point(center)
        found[:, :, 1:4] = root[:, :, None] ** 2 * self._point_slopes(center)
        found[:, :6, 4:] = np.einsum("sab,kb->ksa", self._tensor, factor)
        return found

    def curvature(self, theta: Array, slopes: Array) -> Array:
        """Second derivatives of <slopes, inertial> with slopes (links, 10) held constant, (links, 10, 10)."""
        root, center = theta[:, :1], theta[:, 1:4]
        found = np.zeros((len(theta), 10, 10))
        found[:, 0, 0] = 2.0 * np.einsum("ks,ks->k", slopes, self._point(center))
        found[:, 0, 1:4] = 2.0 * root * np.einsum("ks,ksi->ki", slopes, self._point_slopes(center))
        found[:, 1:4, 0] = found[:, 0, 1:4]
        # <slopes, L> of a point at c is cᵀ (tr(G) 1 - G) c with the matrix G of the slopes.
        G = _symmetric(slopes[:, :6] * np.where(ROWS == COLUMNS, 1.0, 0.5))
        found[:, 1:4, 1:4] = 2.0 * root[:, :, None] ** 2 * (np.trace(G, axis1=1, axis2=2)[:, None, None] * EYE - G)
        found[:, 4:, 4:] = np.einsum("sab,ks->kab", self._tensor, slopes[:, :6])
        return found

    def theta(self, inertial: Array) -> Array:
        """θ of parameters strictly inside the conditions, (links, 10)."""
        mass = inertial[:, 9:]
        center = inertial[:, 6:9] / mass
        tensor = inertial[:, :6] - mass * self._point(center)[:, :6]
        if self.second_moments:
            tensor = tensor @ np.linalg.inv(COMPLEMENT)
        factor = np.linalg.cholesky(_symmetric(tensor))
        return np.concatenate([np.sqrt(mass), center, factor.swapaxes(1, 2)[:, ROWS, COLUMNS]], axis=1)

    @property
    def _tensor(self) -> Array:
        return np.tensordot(COMPLEMENT, OUTER, axes=1) if self.second_moments else OUTER

    @staticmethod
    def _point(center: Array) -> Array:
        """Inertial parameters of a point of mass 1, (links, 10)."""
        tensor = np.sum(center**2, axis=1)[:, None, None] * EYE - center[:, :, None] * center[:, None, :]
        return np.concatenate([tensor[:, ROWS, COLUMNS], center, np.ones((len(center), 1))], axis=1)

    @staticmethod
    def _point_slopes(center: Array) -> Array:
        """Their derivatives by the point's place, (links, 10, 3)."""
        found = np.zeros((len(center), 10, 3))
        tensor = 2.0 * center[:, None, None, :] * EYE[:, :, None]
        tensor = tensor - np.einsum("ia,kj->kija", EYE, center) - np.einsum("ja,ki->kija", EYE, center)
        found[:, :6] = tensor[:, ROWS, COLUMNS]
        found[:, 6:9] = EYE
        return found


def _orthonormal_basis() -> Array:
    """Of symmetric matrices of order 4, (10, 4, 4)."""
    rows, columns = np.triu_indices(4)
    found = np.zeros((10, 4, 4))
    found[np.arange(10), rows, columns] = found[np.arange(10), columns, rows] = np.where(
        rows == columns, 1.0, np.sqrt(0.5)
    )
    return found


BASIS = _orthonormal_basis()
BASIS_INERTIAL = parameters_of_pseudo_inertia(BASIS)

# Elements of U that belong to d1 d2 d3 s12 s23 s13 t1 t2 t3, in the order of the paper.
U_ROWS = np.array([0, 1, 2, 0, 1, 0, 0, 1, 2])
U_COLUMNS = np.array([0, 1, 2, 1, 2, 2, 3, 3, 3])


@dataclass(frozen=True)
class LogCholesky:
    """θ = (α, d1, d2, d3, s12, s23, s13, t1, t2, t3) with the pseudo-inertia P = U Uᵀ (Rucker and Wensing 2022).

    U = exp(α) [[exp(d1), s12, s13, t1], [0, exp(d2), s23, t2], [0, 0, exp(d3), t3], [0, 0, 0, 1]]: every θ gives a
    positive definite P, and every such P has one θ.
    """

    def inertial(self, theta: Array) -> Array:
        """Inertial parameters, (links, 10), of θ (links, 10)."""
        U = self._factor(theta)
        return parameters_of_pseudo_inertia(U @ U.swapaxes(1, 2))

    def jacobian(self, theta: Array) -> Array:
        """Their derivatives by θ, (links, 10, 10)."""
        U, slopes = self._factor(theta), self._factor_slopes(theta)
        half = np.einsum("kaij,klj->kail", slopes, U)
        whole = half + half.swapaxes(2, 3)
        flat = parameters_of_pseudo_inertia(whole.reshape(-1, 4, 4)).reshape(len(theta), 10, 10)
        return np.asarray(flat.swapaxes(1, 2))

    def curvature(self, theta: Array, slopes: Array) -> Array:
        """Second derivatives of <slopes, inertial> with slopes (links, 10) held constant, (links, 10, 10)."""
        U, first = self._factor(theta), self._factor_slopes(theta)
        G = np.einsum("ks,as,aij->kij", slopes, BASIS_INERTIAL, BASIS, optimize=True)  # <G, P(δ)> = <slopes, δ>
        found = np.asarray(2.0 * np.einsum("kaij,kil,kblj->kab", first, G, first, optimize=True))
        along = 2.0 * np.einsum("kaij,kil,klj->ka", first, G, U, optimize=True)
        # α and a d meet themselves, and α meets all, with the first derivative of U once more.
        found[:, 0, :] += along
        found[:, 1:, 0] += along[:, 1:]
        for i in (1, 2, 3):
            found[:, i, i] += along[:, i]
        return found

    def theta(self, inertial: Array) -> Array:
        """θ of parameters strictly inside the conditions, (links, 10)."""
        # U from the Cholesky factor of P with rows and columns in reverse order.
        P = pseudo_inertia(inertial)
        U = np.linalg.cholesky(P[:, ::-1, ::-1])[:, ::-1, ::-1]
        scale = U[:, 3, 3]
        found = np.empty((len(inertial), 10))
        found[:, 0] = np.log(scale)
        found[:, 1:] = U[:, U_ROWS, U_COLUMNS] / scale[:, None]
        found[:, 1:4] = np.log(found[:, 1:4])
        return found

    @staticmethod
    def _factor(theta: Array) -> Array:
        U = np.zeros((len(theta), 4, 4))
        U[:, U_ROWS, U_COLUMNS] = np.concatenate([np.exp(theta[:, 1:4]), theta[:, 4:]], axis=1)
        U[:, 3, 3] = 1.0
        return np.asarray(np.exp(theta[:, 0])[:, None, None] * U)

    def _factor_slopes(self, theta: Array) -> Array:
        """Derivatives of U by θ, (links, 10, 4, 4)."""
        found = np.zeros((len(theta), 10, 4, 4))
        found[:, 0] = self._factor(theta)
        elements = np.ones((len(theta), 9))
        elements[:, :3] = np.exp(theta[:, 1:4])
        found[:, np.arange(1, 10), U_ROWS, U_COLUMNS] = np.exp(theta[:, :1]) * elements
        return found
