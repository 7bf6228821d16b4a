"""Newton's method for the centre of the dual points: it meets a feasible point, or runs into a proof of none.

The function v(W) - Σ log det W_b, with v(W) = Σ <D_b(δ), W_b> for dual points W, has a minimum exactly where the base
parameters are strictly feasible: there W_b⁻¹ = D_b(δ) for a δ in the middle of its fibre. Otherwise it falls without
end, and v becomes negative. The function is self-concordant, so that steps do not depend on units, however much
smaller some links are than others (Nesterov and Nemirovskii 1994; on such dual steps, Benson, Ye and Zhang 2000).
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .fibre import Fibre

__all__ = ["Centre", "centre"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

CLEARLY_INSIDE = 1e-3
"""A step whose point has scaled eigenvalues above this has found a feasible point."""

LARGEST = 1e60
"""Dual points grow without end exactly on the boundary; beyond this nothing more is learnt."""


@dataclass(frozen=True, eq=False)
class Centre:
    """Where the iterations stopped.

    Attributes
    ----------
    matrices : tuple of (r, r)
        W, positive definite.
    parameters : (n,)
        The best δ that belongs to it; where `feasible`, its blocks are positive definite on the face.
    feasible : bool
    value : float
        v; where it is negative W is a proof, up to rounding.
    """

    matrices: tuple[Matrix, ...]
    parameters: Vector
    feasible: bool
    value: float


def centre(fibre: Fibre, matrices: tuple[Matrix, ...], iterations: int) -> Centre | None:
    """Iterate from a dual point inside the cone; None where rounding leads out of it.

    Parameters
    ----------
    fibre : Fibre
    matrices : tuple of (r, r)
        W to start from.
    iterations : int
        Most Newton steps.
    """
    parameters = fibre.origin
    value, inside = np.inf, False
    for _ in range(iterations):
        if not all(np.all(np.abs(matrix) < LARGEST) for matrix in matrices):
            return None
        try:
            metric = fibre.metric(matrices)
        except np.linalg.LinAlgError:
            return None
        scaled = metric.stacked(fibre.blocks(parameters))
        unit = fibre.stack.identity
        value = float(unit @ scaled)
        if value < 0:
            break
        target = unit - scaled
        step = metric.across(target)
        parameters = parameters + fibre.directions @ metric.along(metric.Q.T @ target)
        eigenvalues = np.concatenate([np.linalg.eigvalsh(change) for change in fibre.stack.matrices(step)])
        if eigenvalues.max(initial=0.0) < 1 - CLEARLY_INSIDE:
            inside = True
            break
        # The slope of v is the product of the step with any block of the fibre, such as unit - step.
        slope = float(step @ unit - step @ step)
        length = _line_minimum(slope, eigenvalues, value)
        matrices = tuple(
            matrix + length * change for matrix, change in zip(matrices, metric.expanded(step), strict=True)
        )
    return Centre(matrices, parameters, inside, value)


def _line_minimum(slope: float, eigenvalues: Vector, value: float) -> float:
    """Least a·slope - Σ log(1 + a e) over a > 0, by Newton's method; far along where it falls without end."""
    smallest = float(eigenvalues.min(initial=0.0))
    limit = -1.0 / smallest if smallest < 0 else np.inf
    if slope < 0 and not np.isfinite(limit):
        return 2.0 * value / -slope
    length = 1.0 / (1.0 + float(np.linalg.norm(eigenvalues)))
    for _ in range(60):
        terms = eigenvalues / (1.0 + length * eigenvalues)
        first, second = slope - float(terms.sum()), float(terms @ terms)
        if second == 0.0:  # nothing changes along this step
            break
        new = length - first / second
        if new <= 0:
            new = 0.5 * length
        elif new >= 0.99 * limit:
            new = 0.5 * (length + 0.99 * limit)
        if abs(new - length) <= 1e-4 * length:
            break
        length = new
    return float(length)
