"""From a solver's accuracy to that of floating point: where dual matrices vanish."""

import numpy as np
import numpy.typing as npt
import scipy.linalg as linalg

from steelyard.lmi import AffineStack, symmetric_to_vector, vector_to_symmetric

__all__ = ["polished_pair"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

STEPS, CONVERGED, DIVERGED = 8, 1e-14, 1e6


def polished_pair(
    stack: AffineStack, unseen: Matrix, duals: tuple[Matrix, ...], recession: tuple[Matrix, ...]
) -> tuple[tuple[Matrix, ...], tuple[Matrix, ...]]:
    """Dual matrices Z_b whose null spaces are right to rounding, by Newton's method on D_b Z_b = 0.

    D runs through the blocks of parameters that nothing shows, Z through all that is orthogonal to them. A solver
    ends with D Z of about its tolerance, so that null vectors are accurate to its root only. Where Z + D is definite,
    D Z = 0 fixes the null spaces: for a change of both with δD Z + D δZ = 0, the product <δD, δZ>, which is zero,
    would be negative unless the null spaces stay. Other freedom is left by least-norm steps.

    Parameters
    ----------
    stack : AffineStack
        Blocks in the parameters that the motion does not show.
    unseen : (n_d, ...)
        Directions that the equations of constraints do not show either.
    duals, recession : tuple of (d, d)
        Z and D of a solver.

    Returns
    -------
    duals, recession : tuple of (d, d)
        As they came, where the method does not converge.
    """
    columns = stack.coefficients @ unseen
    lengths = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, lengths > 0] / lengths[lengths > 0], full_matrices=True)
    rank = int(np.sum(singular > 1e-10 * singular.max(initial=0.0)))
    values = [np.concatenate([symmetric_to_vector(M) for M in _stacked(stack, m)]) for m in (recession, duals)]
    point = np.concatenate([left[:, :rank].T @ values[0], left[:, rank:].T @ values[1]])
    scale = float(np.linalg.norm(point))
    if scale == 0.0:
        return duals, recession
    directions = [vector_to_symmetric(left[rows].T) for rows in stack.slices]
    best = np.inf
    for _ in range(STEPS):
        D, Z = stack.matrices(left[:, :rank] @ point[:rank]), stack.matrices(left[:, rank:] @ point[rank:])
        residual = np.concatenate([(d @ z).ravel() for d, z in zip(D, Z, strict=True)])
        error = float(np.linalg.norm(residual))
        if not error < DIVERGED * scale:
            break
        if error <= CONVERGED * scale:
            return Z, D
        if error > 0.5 * best and error <= 1e-11 * scale:
            return Z, D
        best = min(best, error)
        jacobian = np.concatenate(
            [
                np.concatenate([M[:rank] @ z, d @ M[rank:]]).reshape(len(point), -1)
                for M, d, z in zip(directions, D, Z, strict=True)
            ],
            axis=1,
        ).T
        # LAPACK's gelsd, the default, does not converge on some of these matrices.
        point = point - linalg.lstsq(jacobian, residual, cond=1e-9, lapack_driver="gelsy")[0]
    return duals, recession


def _stacked(stack: AffineStack, matrices: tuple[Matrix, ...]) -> list[Matrix]:
    return [matrices[index] for index in stack.order]
