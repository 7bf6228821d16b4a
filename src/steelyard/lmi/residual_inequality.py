"""Squared distances and squared residuals as linear matrix inequalities, the matrices U of the thesis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.files import read_number

from .affine import AffineBlock
from .inequality import MOST_NUMBERS, LinearMatrixInequality
from .linear_expression import distinct_names

__all__ = ["distance_inequality", "residual_inequality"]


def distance_inequality(target: npt.ArrayLike, names: Sequence[str], bound: str = "u") -> LinearMatrixInequality:
    """U ⪰ 0, which says that u ≥ ‖target - x‖² (thesis 3.38).

    U = [[u, (target - x)ᵀ], [target - x, 1]]: (3.39) where x are base parameters, (3.57) where they are standard ones.

    Parameters
    ----------
    target : (c,)
        The given parameters.
    names : sequence of c str
        The variables x.
    bound : str
        Name of the variable u.

    Returns
    -------
    LinearMatrixInequality
        One block of order c + 1, in u and x.

    Raises
    ------
    InputError
        If lengths differ, a value is not finite, or a name is given twice.

    Examples
    --------
    >>> print(distance_inequality([1.5, 2.0], ["beta1", "beta2"]))
    squared distance <= u:
    ⎡ u             -beta1 + 1.5  -beta2 + 2 ⎤
    ⎢ -beta1 + 1.5  1             0          ⎥
    ⎣ -beta2 + 2    0             1          ⎦ ⪰ 0
    """
    given = _finite(target, "target", 1)
    return _schur(np.eye(len(given)), given, 0.0, names, bound, "squared distance <= u")


def residual_inequality(
    matrix: npt.ArrayLike,
    vector: npt.ArrayLike,
    names: Sequence[str],
    constant: float = 0.0,
    bound: str = "u",
) -> LinearMatrixInequality:
    """U ⪰ 0, which says that u ≥ ‖vector - matrix x‖² + constant (thesis 3.42, 3.50).

    U = [[u - constant, (vector - matrix x)ᵀ], [vector - matrix x, 1]]: (3.43) with the data themselves, W and ω; (3.52)
    with the reduced R₁, ρ₁ and constant ‖ρ₂‖², of the order of the parameters rather than that of the data.

    Parameters
    ----------
    matrix : (rows, c)
        W or R₁.
    vector : (rows,)
        ω or ρ₁.
    names : sequence of c str
        The variables x.
    constant : float
        ‖ρ₂‖², not negative.
    bound : str
        Name of the variable u.

    Returns
    -------
    LinearMatrixInequality
        One block of order rows + 1, in u and x.

    Raises
    ------
    InputError
        If shapes differ, a value is not finite, or the block would be too large.

    Examples
    --------
    >>> print(residual_inequality([[2.0, 1.0], [0.0, 3.0]], [5.0, 6.0], ["beta1", "beta2"], constant=0.25))
    squared residual <= u:
    ⎡ u - 0.25                -2*beta1 - beta2 + 5  -3*beta2 + 6 ⎤
    ⎢ -2*beta1 - beta2 + 5    1                     0            ⎥
    ⎣ -3*beta2 + 6            0                     1            ⎦ ⪰ 0
    """
    rows, values = _finite(matrix, "matrix", 2), _finite(vector, "vector", 1)
    offset = read_number(constant, "constant", "a number of at least 0, the squared norm of rho2", least=0)
    return _schur(rows, values, offset, names, bound, "squared residual <= u")


def _schur(
    matrix: npt.NDArray[np.float64],
    vector: npt.NDArray[np.float64],
    constant: float,
    names: Sequence[str],
    bound: str,
    label: str,
) -> LinearMatrixInequality:
    variables = distinct_names((bound, *distinct_names(names)))
    count, size = len(variables) - 1, len(vector) + 1
    if matrix.shape != (len(vector), count):
        raise InputError(
            f"{len(vector)} rows in {count} variables need a matrix of shape ({len(vector)}, {count}), "
            f"got {matrix.shape}."
        )
    used = np.flatnonzero(np.any(matrix != 0.0, axis=0))
    if (len(used) + 1) * size**2 > MOST_NUMBERS:
        raise InputError(
            f"{len(vector)} rows in {count} variables make a block of order {size}, which is too large; reduce the "
            "rows to the triangular factor of [W ω] first, with constant=‖ρ₂‖²."
        )
    fixed = np.eye(size)
    fixed[0, 0] = -constant
    fixed[0, 1:] = fixed[1:, 0] = vector
    coefficients = np.zeros((len(used) + 1, size, size))
    coefficients[0, 0, 0] = 1.0
    coefficients[1:, 0, 1:] = coefficients[1:, 1:, 0] = -matrix[:, used].T
    indices = np.concatenate([[0], used + 1]).astype(np.intp)
    block = AffineBlock(label, fixed + 0.0, indices, coefficients + 0.0, "constraint")
    return LinearMatrixInequality(variables, (block,))


def _finite(values: npt.ArrayLike, name: str, dimensions: int) -> npt.NDArray[np.float64]:
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers in {dimensions} dimension{'s' * (dimensions > 1)}.") from None
    if array.ndim != dimensions:
        raise InputError(f"{name} must have {dimensions} dimension{'s' * (dimensions > 1)}, got shape {array.shape}.")
    if not np.all(np.isfinite(array)):
        raise InputError(f"{name} holds a value that is not finite; remove such rows.")
    return array
