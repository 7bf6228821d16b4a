"""Moving a point that a solver left just outside the set to its inside."""

import numpy as np
import numpy.typing as npt

from steelyard.lmi import AffineStack, vector_to_symmetric

from .feasible_set import FeasibleSet

__all__ = ["MARGIN_FACTORS", "least_eigenvalue", "pull_inside"]

Vector = npt.NDArray[np.float64]

MARGIN_FACTORS = (1.0, 1.5, 3.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6)
"""Factors of the margin that are tried in turn while the solver ends outside the set; the last makes a margin of 1e-6
one of 1 SI unit, for robots of tonnes."""

STEPS = 30
"""Bisections, after which the distance to the best point is 1e-9 of the line."""


def least_eigenvalue(stack: AffineStack, parameters: Vector) -> float:
    """Smallest eigenvalue of all blocks at δ; blocks of one size are taken together."""
    vector = stack.constant + stack.coefficients @ parameters
    least = float(vector[: stack.scalar_count].min(initial=np.inf))
    start, sizes = stack.scalar_count, stack.matrix_sizes
    first = 0
    while first < len(sizes):
        size, last = sizes[first], first
        while last < len(sizes) and sizes[last] == size:
            last += 1
        rows = size * (size + 1) // 2
        part = vector[start : start + (last - first) * rows].reshape(-1, rows)
        least = min(least, float(np.linalg.eigvalsh(vector_to_symmetric(part)).min()))
        start, first = start + part.size, last
    return least


def pull_inside(feasible_set: FeasibleSet, outside: Vector, inside: Vector) -> Vector:
    """The point nearest to `outside`, on the line to `inside`, that is well inside.

    Well inside means half the margin, or a tenth of that of the point `inside` if it is smaller. The set is convex, so
    that bisection finds the point; equations that hold at both ends hold between them.

    Parameters
    ----------
    feasible_set : FeasibleSet
    outside : (n,)
    inside : (n,)
        A point that `feasible_set.contains`.

    Returns
    -------
    (n,)
        A point that `feasible_set.contains`.
    """
    least = min(0.5 * feasible_set.margin, 0.1 * least_eigenvalue(feasible_set.stack, inside))
    low, high, best = 0.0, 1.0, inside
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        point = outside + middle * (inside - outside)
        if least_eigenvalue(feasible_set.stack, point) >= least and feasible_set.contains(point):
            high, best = middle, point
        else:
            low = middle
    return best
