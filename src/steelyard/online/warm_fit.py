"""The plausible fit within a feasible set, solved again and again from the answer before, in milliseconds."""

from __future__ import annotations

from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from steelyard.errors import SolverError
from steelyard.estimators.prior import PreparedPrior
from steelyard.feasibility import FeasibleSet
from steelyard.feasibility.barrier import add_log_determinants, linear_conditions, matrix_conditions, newton_solutions

__all__ = ["WarmAnswer", "WarmFit"]

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


@dataclass(frozen=True, eq=False)
class WarmAnswer:
    """The point that a search reached.

    Attributes
    ----------
    parameters : (n,)
        Inside the set, whether or not the search ended.
    converged : bool
        Whether the optimum was reached to the accuracy that was asked for, before the time or the steps ran out.
    steps : int
    seconds : float
    """

    parameters: Array = field(repr=False)
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
        Keeps its margin from the boundary, as `steelyard.fit` does.
    """

    def __init__(self, feasible_set: FeasibleSet) -> None:
        self.feasible_set = feasible_set
        self.K = np.asarray(feasible_set.K)
        margin = feasible_set.margin
        self._rows, constants = linear_conditions(feasible_set.blocks, feasible_set.parameter_count)
        self._constants = constants - margin
        self._groups = [
            (own, coefficients, constants - margin * np.eye(constants.shape[-1]))
            for own, coefficients, constants in matrix_conditions(feasible_set.blocks)
        ]
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
        steps, converged = 0, False
        while steps < MOST_STEPS and perf_counter() - begun < seconds:
            gradient = scaled.T @ (scaled @ point - target)
            hessian = curvature.copy()
            prior.add_derivatives(point[None], np.array([weight]), gradient[None], hessian[None])
            self._add_barriers(point, barrier, gradient, hessian)
            stiffness = multipliers / slacks
            hessian += (self._rows.T * stiffness) @ self._rows
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
            if barrier <= accuracy and length == 1.0 and decrease <= min(STATIONARY, accuracy) and off_center < 0.9:
                converged = True
                break
            if centered:
                barrier = max(accuracy, REDUCTION * barrier)
        self.start, self._multipliers = point, multipliers
        return WarmAnswer(point, converged, steps, perf_counter() - begun)

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
