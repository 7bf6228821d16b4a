"""Parameters of which data and conditions say nothing together with others: their value is a choice by itself."""

import numpy as np
import numpy.typing as npt

from steelyard.feasibility.feasible_set import FeasibleSet
from steelyard.feasibility.tie_break import Preference
from steelyard.regression import column_lengths

from .prior import PreparedPrior

__all__ = ["settled"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ABSENT = 1e-12
"""Columns shorter than this, relative to the longest, are absent."""


def settled(
    feasible: FeasibleSet, R: Matrix, parameters: Vector, preference: Preference | PreparedPrior | None
) -> Vector:
    """The same parameters, with the preferred value, or zero, where no torque shows a parameter.

    Such is the friction of a joint that does not move or whose torque is not used. A solver leaves it wherever it
    stopped, often at one large value for all of them: beside masses in kg the preference hardly weighs it, and where
    the solver finds no better answer than one of least residual, not at all. As neither the data nor a condition ties
    it to other parameters, its value is chosen by itself, and exactly.

    Parameters
    ----------
    feasible : FeasibleSet
    R : (n_b, n_b)
        Of the reduced regression.
    parameters : (n,)
    preference : Preference or PreparedPrior or None
        A prior decides those that it knows; zero is preferred where there is nothing else.

    Returns
    -------
    (n,)
    """
    lengths = column_lengths(R @ feasible.K)
    free = lengths <= ABSENT * lengths.max(initial=0.0)
    if not free.any():
        return parameters
    free &= ~np.any(feasible.equation_matrix != 0.0, axis=0)
    low, high = np.full(len(parameters), -np.inf), np.full(len(parameters), np.inf)
    for block in feasible.blocks:
        used = [int(i) for i, c in zip(block.indices, block.coefficients, strict=True) if np.any(c)]
        if block.size > 1 or len(used) != 1:
            free[used] = False
            continue
        index = used[0]
        coefficient = float(block.coefficients[list(block.indices).index(index), 0, 0])
        edge = (feasible.margin - float(block.constant[0, 0])) / coefficient
        if coefficient > 0:
            low[index] = max(low[index], edge)
        else:
            high[index] = min(high[index], edge)
    free &= low <= high
    if isinstance(preference, PreparedPrior):
        free &= np.asarray(abs(preference.curvature()).sum(axis=0)).ravel() == 0.0
    result = parameters.copy()
    for index in map(int, np.flatnonzero(free)):
        target = preference.alone(index, result) if isinstance(preference, Preference) else 0.0
        result[index] = np.clip(target, low[index], high[index])
    return result
