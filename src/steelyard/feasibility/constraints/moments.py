"""Second moments of a body: the pseudo-inertia and how it changes with the frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["PSEUDO_INERTIA", "moment_row", "parameters_of_pseudo_inertia", "pseudo_inertia", "transformation"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


def pseudo_inertia(parameters: npt.ArrayLike) -> Matrix:
    """P = ∫ (r, 1)(r, 1)ᵀ dm = [[tr(L)/2 1 - L, l], [lᵀ, m]] (Wensing, Kim and Slotine 2018).

    Parameters
    ----------
    parameters : (10,)
        Lxx Lxy Lxz Lyy Lyz Lzz lx ly lz m.

    Returns
    -------
    (4, 4)

    Examples
    --------
    A point of 2 kg at x = 3:

    >>> pseudo_inertia([0, 0, 0, 18, 0, 18, 6, 0, 0, 2])[[0, 0, 3], [0, 3, 3]].tolist()
    [18.0, 6.0, 2.0]
    """
    xx, xy, xz, yy, yz, zz, x, y, z, m = np.asarray(parameters, dtype=float)
    half = 0.5 * (xx + yy + zz)
    return np.array([[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, m]]) + 0.0


def parameters_of_pseudo_inertia(matrix: Matrix) -> Vector:
    """Undo `pseudo_inertia`: (10,) from (4, 4)."""
    second = matrix[:3, :3]
    inertia = np.trace(second) * np.eye(3) - second
    return np.concatenate([inertia[np.triu_indices(3)], matrix[:3, 3], [matrix[3, 3]]])


PSEUDO_INERTIA = np.array([pseudo_inertia(unit) for unit in np.eye(10)])
"""Coefficients of the pseudo-inertia in the ten parameters, (10, 4, 4)."""
PSEUDO_INERTIA.setflags(write=False)


def moment_row(quadratic: Matrix) -> Vector:
    """The moment ∫ (r, 1)ᵀ Q (r, 1) dm = tr(P Q) as a row over the ten parameters.

    Parameters
    ----------
    quadratic : (4, 4)
        Q, symmetric: a quadratic function of the place r.

    Returns
    -------
    (10,)

    Examples
    --------
    >>> moment_row(np.diag([0.0, 0.0, 0.0, 1.0])).tolist()[-1]
    1.0
    """
    return np.asarray(np.einsum("kij,ij->k", PSEUDO_INERTIA, quadratic)) + 0.0


def transformation(placement: Matrix) -> Matrix:
    """How the ten parameters change where every point r of the body goes to T (r, 1): P becomes T P Tᵀ.

    Parameters
    ----------
    placement : (4, 4)
        T: a rigid motion, or one with a reflection.

    Returns
    -------
    (10, 10)

    Examples
    --------
    >>> reflection = np.diag([-1.0, 1.0, 1.0, 1.0])
    >>> np.diag(transformation(reflection)).astype(int).tolist()
    [1, -1, -1, 1, 1, 1, -1, 1, 1, 1]
    """
    columns = [parameters_of_pseudo_inertia(placement @ unit @ placement.T) for unit in PSEUDO_INERTIA]
    return np.array(columns).T + 0.0
