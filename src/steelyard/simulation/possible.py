"""Whether the inertia matrices that a run went through are those of a robot that can exist."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .plant import Plant

__all__ = ["first_impossible", "least_inertia"]

Array = NDArray[np.float64]
MOST = 400  # matrices that are looked at in all the runs, and at least eight of each run


def least_inertia(plant: Plant, run: int, q: Array) -> Array:
    """Return the least eigenvalues (m,) of a run's total inertia matrices at q (m, N); NaN where not finite."""
    functions, n = plant.functions, plant.count
    parameters = plant.parameters[run] if functions.each else plant.parameters
    kernel = functions.model.kernel("total_inertia_matrix", base=functions.base)
    if functions.each or len(q) == 1:
        matrices = np.array([kernel.sample(np.ascontiguousarray(x), parameters) for x in q]).reshape(-1, n, n)
    else:
        matrices = kernel(np.ascontiguousarray(q), parameters).reshape(-1, n, n)
    finite = np.isfinite(matrices).all(axis=(1, 2))
    least = np.full(len(q), np.nan)
    least[finite] = np.linalg.eigvalsh(matrices[finite])[:, 0]
    return least


def first_impossible(plant: Plant, run: int, q: Array) -> tuple[int, float] | None:
    """Find the first of a run's positions (S, N) at which its inertia matrix is not positive definite.

    Parameters
    ----------
    plant : Plant
    run : int
    q : ndarray
        (S, N) of the samples: the first, and some evenly among the others, are looked at; where one of them is
        impossible, all between it and the one before are.

    Returns
    -------
    (int, float) or None
        The sample and the least eigenvalue there.
    """
    some = np.unique(np.linspace(0, len(q) - 1, min(len(q), max(8, MOST // plant.runs))).round().astype(np.intp))
    found = np.flatnonzero(least_inertia(plant, run, q[some]) <= 0.0)
    if not found.size:
        return None
    place = int(found[0])
    begin, end = (0 if place == 0 else int(some[place - 1]) + 1), int(some[place]) + 1
    least = least_inertia(plant, run, q[begin:end])
    first = int(np.flatnonzero(least <= 0.0)[0])
    return begin + first, float(least[first])
