"""The fit near a prior within a feasible set, by an interior-point method that can start from an answer before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import SolverError
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.barrier import LinearConditions, add_log_determinants, matrix_conditions, newton_solutions
from steelyard.lmi import symmetric_to_vector, vector_to_symmetric

from .prior import PreparedPrior

__all__ = ["WarmAnswer", "WarmFit", "start_near"]

Array = NDArray[np.float64]

FIRST_BARRIER = 1e-2
"""At which a search starts where there is no answer before; it moves answers by a tenth of what noise does."""

REDUCTION = 0.05
"""The factor by which the complementarity is reduced in each step. With 0.2 a cold start takes 18 steps, with 0.01 some
warm ones lose their centre and take 30; 0.05 takes 9 to 12 cold, 3 to 6 warm (the seven-joint arm)."""

TO_BOUNDARY = 0.95
"""Part of the way to the boundary of the set that a step goes at most."""

SHORTEST = 1e-6
"""Part of a step: where rounding lets even this leave the set, the search has ended."""

STATIONARY = 1e-9
"""Squared length of a Newton step in the local metric, below which it moves nothing."""

MOST_STEPS = 80
"""Far more than any start needs; it ends searches that rounding keeps from their end."""

START = 1e-3
"""Terms start at this part of their size where least squares have them at less, or below zero. With a tenth, the fits
of a cross-validation take twice as many steps, since most of what is friction of motors in a model with that of joints,
too, is next to zero."""


@dataclass(frozen=True, eq=False)
class WarmAnswer:
    """The point that a search reached.

    Attributes
    ----------
    parameters : (n,)
        Inside the set, whether or not the search ended.
    multipliers : (rows,)
        Of the stacked blocks of the set: a point of the dual cone, from which a lower bound of the objective follows.
    complementarity : float
        Of each condition, where the search was last close to the central path; infinite where it never was.
    converged : bool
        Whether the optimum was reached to the accuracy that was asked for, before the time or the steps ran out.
    steps : int
    seconds : float
    """

    parameters: Array = field(repr=False)
    multipliers: Array = field(repr=False)
    complementarity: float
    converged: bool
    steps: int
    seconds: float


class WarmFit:
    """Minimises ½ ‖R K δ - ρ‖² / variance + weight · (distance from the prior) within a feasible set.

    A primal-dual interior-point method whose every iterate lies inside the set, so that it may be stopped at any time.
    Linear conditions have multipliers; matrices stay positive definite by a barrier as small as the complementarity,
    and by the prior's own logarithm of determinants.

    Parameters
    ----------
    feasible_set : FeasibleSet
    margins : (rows,), optional
        Stacked matrices that are subtracted from the blocks of the set; its margin in SI where absent.
    """

    def __init__(self, feasible_set: FeasibleSet, margins: Array | None = None) -> None:
        self.feasible_set = feasible_set
        self.K = np.asarray(feasible_set.K)
        stack = feasible_set.stack
        self.margins = feasible_set.margin * stack.identity if margins is None else margins
        blocks = [
            replace(block, constant=block.constant - own)
            for block, own in zip(stack.blocks, stack.matrices(self.margins), strict=True)
        ]
        self._lines = LinearConditions(blocks, feasible_set.parameter_count)
        self._rows, self._constants = self._lines.rows, self._lines.constants
        self._groups = matrix_conditions(blocks)
        self._basis = feasible_set.equation_directions
        self.start: Array | None = None
        self._multipliers = np.ones(len(self._rows))

    def inside(self, parameters: Array) -> bool:
        """Return whether every condition holds with the margin, and matrices have the factors that a step needs."""
        if not np.all(self._rows @ parameters + self._constants > 0.0):
            return False
        try:
            for own, coefficients, constants in self._groups:
                np.linalg.cholesky(constants + np.einsum("bi,biac->bac", parameters[own], coefficients))
        except np.linalg.LinAlgError:
            return False
        return True

    def begin(self, parameters: Array) -> None:
        """Start the next search here, inside the set.

        Raises
        ------
        SolverError
            If the parameters are not inside the set.
        """
        if not self.inside(parameters) or not self.feasible_set.satisfies_equations(parameters):
            raise SolverError("A search must start inside the feasible set; give parameters that satisfy it.")
        self.start = np.array(parameters)
        self._multipliers = FIRST_BARRIER / (self._rows @ parameters + self._constants)

    def solve(
        self,
        R: Array,
        rho: Array,
        variance: float,
        prior: PreparedPrior,
        weight: float,
        *,
        accuracy: float = 1e-6,
        seconds: float = np.inf,
        most_steps: int = MOST_STEPS,
    ) -> WarmAnswer:
        """Search from where the last search ended.

        Parameters
        ----------
        R, rho : (n_b, n_b), (n_b,)
            The reduced regression, weighted.
        variance : float
            Of its rows.
        prior : PreparedPrior
        weight : float
        accuracy : float
            Complementarity at which the search ends.
        seconds : float
            After which it is stopped where it is.
        most_steps : int
            After which it is stopped where it is, too.

        Returns
        -------
        WarmAnswer
        """
        begun = perf_counter()
        assert self.start is not None
        point, multipliers = self.start, self._multipliers
        scaled = (R @ self.K) / np.sqrt(variance)
        target = rho / np.sqrt(variance)
        curvature = scaled.T @ scaled
        slacks = self._rows @ point + self._constants
        # The multipliers may be far from the path where the data changed: the complementarity starts where they are.
        barrier = max(accuracy, min(FIRST_BARRIER, float(np.max(slacks * multipliers, initial=0.0))))
        steps, converged, reached = 0, False, np.inf
        while steps < most_steps and perf_counter() - begun < seconds:
            gradient = scaled.T @ (scaled @ point - target)
            hessian = curvature.copy()
            prior.add_derivatives(point[None], np.array([weight]), gradient[None], hessian[None])
            self._add_barriers(point, barrier, gradient, hessian)
            stiffness = multipliers / slacks
            self._lines.add_squares(np.sqrt(stiffness)[None], hessian[None])
            gradient -= self._rows.T @ (barrier / slacks)
            step = newton_solutions(hessian[None], -gradient[None, None], self._basis)[0, 0]
            decrease = -float(gradient @ step)
            change = self._rows @ step
            change_of_multipliers = barrier / slacks - multipliers - stiffness * change
            length = min(1.0, TO_BOUNDARY * self._longest(point, step, slacks, change))
            dual_length = min(1.0, TO_BOUNDARY * _times_until_zero(multipliers, change_of_multipliers))
            moved = point + length * step
            while length > SHORTEST and not self.inside(moved):
                length *= 0.5
                moved = point + length * step
            if length <= SHORTEST:  # as near to the boundary as rounding lets it
                break
            point = moved
            multipliers = multipliers + dual_length * change_of_multipliers
            slacks = self._rows @ point + self._constants
            steps += 1
            off_center = float(np.max(np.abs(slacks * multipliers / barrier - 1.0), initial=0.0))
            centered = length > 0.5 and decrease <= max(STATIONARY, barrier) and off_center < 0.9
            if centered:
                reached = barrier
            if barrier <= accuracy and length == 1.0 and decrease <= min(STATIONARY, accuracy) and off_center < 0.9:
                converged = True
                break
            if centered:
                barrier = max(accuracy, REDUCTION * barrier)
        self.start, self._multipliers = point, multipliers
        blocks = self._stacked(point, multipliers, reached if np.isfinite(reached) else barrier)
        return WarmAnswer(point, blocks, reached, converged, steps, perf_counter() - begun)

    def _stacked(self, point: Array, multipliers: Array, barrier: float) -> Array:
        """Return the multipliers of all blocks, those of matrices by their barrier."""
        stack = self.feasible_set.stack
        values = stack.constant + stack.coefficients @ point - self.margins
        found = np.zeros(len(values))
        found[: stack.scalar_count] = multipliers
        for rows in stack.rows_by_size.values():
            found[rows] = barrier * symmetric_to_vector(
                np.asarray(np.linalg.inv(vector_to_symmetric(values[rows])), dtype=float)
            )
        return found

    def _add_barriers(self, point: Array, factor: float, gradient: Array, hessian: Array) -> None:
        for own, coefficients, constants in self._groups:
            matrices = constants + np.einsum("bi,biac->bac", point[own], coefficients)
            add_log_determinants(matrices[None], coefficients, own, np.array([-factor]), gradient[None], hessian[None])

    def _longest(self, point: Array, step: Array, slacks: Array, change: Array) -> float:
        """Return how many times the step reaches the boundary of the set."""
        longest = _times_until_zero(slacks, change)
        for own, coefficients, constants in self._groups:
            matrices = constants + np.einsum("bi,biac->bac", point[own], coefficients)
            roots = np.linalg.inv(np.linalg.cholesky(matrices))
            moved = roots @ np.einsum("bi,biac->bac", step[own], coefficients) @ roots.swapaxes(-1, -2)
            least = float(np.linalg.eigvalsh(moved)[:, 0].min())
            if least < 0.0:
                longest = min(longest, -1.0 / least)
        return longest


def _times_until_zero(values: Array, change: Array) -> float:
    """Return how many times a change can be added to positive values until the first of them is zero."""
    falling = change < 0.0
    return float(np.min(values[falling] / -change[falling], initial=np.inf))


def start_near(
    prior: PreparedPrior, weight: float, curvature: Array, slope: Array, sizes: Array, inside: Callable[[Array], bool]
) -> Array | None:
    """Parameters inside a set: the prior's; None where conditions forbid these.

    Terms that the prior does not know are those of least squares beside its links, if they are positive.

    Parameters
    ----------
    prior : PreparedPrior
    weight : float
    curvature, slope : (n, n), (n,)
        Of the data: the objective is ½ δᵀ curvature δ - slope · δ beside the prior.
    sizes : (n,)
        Typical sizes of terms.
    inside : callable
        Whether parameters (n,) are inside.
    """
    start = prior.reference.copy()
    terms = np.setdiff1d(np.arange(len(start)), prior.feasible_set.link_columns)
    zero = terms[start[terms] == 0.0]
    stiffness = curvature[np.ix_(zero, zero)] + np.diag(weight * prior.diagonal[zero])
    likely = np.linalg.lstsq(stiffness, (slope - curvature @ start)[zero])[0]
    least = START * sizes[zero]
    for values in (np.maximum(likely, least), least):
        start[zero] = values
        if prior.feasible_set.satisfies_equations(start) and inside(start):
            return start
    return None
