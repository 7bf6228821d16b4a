"""A search for feasible standard parameters over a grid, as it was done before feasibility could be decided."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.lmi import AffineBlock

from .method import Problem, Progress

__all__ = ["GridSearch", "search_grid"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

BATCH = 20000
"""Points that are tried together."""

REACH = 2.0
"""How far the grid goes, in typical sizes of each parameter."""


@dataclass(frozen=True, eq=False)
class GridSearch:
    """The result of a grid search.

    Attributes
    ----------
    parameters : (n,) or None
        Feasible standard parameters with these base parameters; None proves nothing.
    tried : int
        Points that were tried.
    points : float
        Points of the whole grid.
    """

    parameters: Vector | None = field(repr=False)
    tried: int
    points: float

    @property
    def sentence(self) -> str:
        """What the search shows, as a sentence."""
        if self.parameters is not None:
            return f"Feasible parameters were found after {self.tried} points of a grid."
        if self.tried >= self.points:
            return f"None of the {self.tried} points of the grid is feasible; that proves nothing of what is between."
        return (
            f"The search tried {self.tried} of {self.points:.3g} points of the grid and found none that is feasible; "
            "that proves nothing."
        )


def search_grid(
    problem: Problem, base: Vector, levels: int, budget: int, seed: int, progress: Progress | None = None
) -> GridSearch:
    """Look for δ_d such that (β - K_d δ_d, δ_d) is feasible, on a grid (thesis 2.79, 2.80).

    Parameters
    ----------
    problem : Problem
    base : (n_b,)
    levels : int
        Values that each dependent parameter takes: from 0 up to twice its typical size where it cannot be negative, as
        masses and moments of inertia, else from minus to plus that.
    budget : int
        Most points to try; a larger grid is sampled at random.
    seed : int
    progress : callable, optional

    Returns
    -------
    GridSearch
    """
    feasible_set = problem.feasible_set
    dependent = np.asarray(feasible_set.model.base_parameters().dependent, dtype=np.intp)
    axes = _axes(problem, levels)[dependent]
    points = float(levels) ** len(dependent)
    whole = points <= budget
    count = int(points) if whole else budget
    random = np.random.default_rng(seed)
    lift = feasible_set.lift @ base
    tried = 0
    while tried < count:
        size = min(BATCH, count - tried)
        if whole:
            digits = np.arange(tried, tried + size)[:, None] // levels ** np.arange(len(dependent))[None, :] % levels
        else:
            digits = random.integers(levels, size=(size, len(dependent)))
        values = np.take_along_axis(axes[None], digits[:, :, None], axis=2)[:, :, 0]
        candidates = lift + values @ feasible_set.unidentifiable.T
        for block in feasible_set.blocks:
            candidates = candidates[_positive(block, candidates)]
            if not len(candidates):
                break
        tried += size
        for candidate in candidates[:10]:
            if feasible_set.contains(candidate):
                return GridSearch(candidate, tried, points)
        if progress is not None:
            progress(f"searched {tried} of {points:.3g} points")
    return GridSearch(None, tried, points)


def _axes(problem: Problem, levels: int) -> Matrix:
    """Values of every standard parameter, (n, levels)."""
    size = REACH * problem.units.parameters
    signed = np.zeros(len(size), dtype=bool)
    signed[problem.links[:, [1, 2, 4, 6, 7, 8]]] = True
    signed[problem.others] = ~np.isfinite(problem.lower_bounds[problem.others])
    low = np.where(signed, -size, 0.0)
    steps = np.linspace(0.0, 1.0, levels)
    return np.asarray(low[:, None] + (size - low)[:, None] * steps)


def _positive(block: AffineBlock, candidates: Matrix) -> npt.NDArray[np.bool_]:
    """Tell which points have a positive definite block (1 x 1: not negative), by the pivots of Gauss elimination."""
    matrices = block.constant + np.tensordot(candidates[:, block.indices], block.coefficients, axes=1)
    if block.size == 1:
        return np.asarray(matrices[:, 0, 0] >= 0.0)
    good = np.ones(len(matrices), dtype=bool)
    for k in range(block.size):
        pivot = matrices[:, k, k]
        good &= pivot > 0.0
        safe = np.where(good, pivot, 1.0)
        row = matrices[:, k, :] / safe[:, None]
        matrices = matrices - matrices[:, :, k, None] * row[:, None, :]
    return good
