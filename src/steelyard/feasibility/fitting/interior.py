"""From a point that a solver left just outside the set to one inside."""

import numpy as np
import numpy.typing as npt

from ..feasible_set import FeasibleSet

__all__ = ["MARGIN_FACTORS", "pull_inside"]

Vector = npt.NDArray[np.float64]

MARGIN_FACTORS = (1.0, 1.5, 3.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6)
"""The margin is multiplied by the next of these where the solver ends outside the set."""

STEPS = 30


def pull_inside(feasible: FeasibleSet, outside: Vector, inside: Vector) -> Vector:
    """The point nearest to `outside`, on the line to `inside`, that keeps half the margin or, failing that, is inside.

    The set is convex, so that a bisection finds it; equations that hold at both ends hold between them.

    Parameters
    ----------
    feasible : FeasibleSet
    outside : (n,)
    inside : (n,)
        A point that `feasible.contains`.

    Returns
    -------
    (n,)
        Contained in the set.
    """
    least = min(0.5 * feasible.margin, float(feasible.stack.smallest_eigenvalues(inside).min(initial=np.inf)))
    low, high, best = 0.0, 1.0, inside
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        point = outside + middle * (inside - outside)
        eigenvalues = feasible.stack.smallest_eigenvalues(point)
        if np.all(eigenvalues >= least) and feasible.contains(point):
            high, best = middle, point
        else:
            low = middle
    return best
