"""Essential parameters, and standard parameters near CAD by singular values (Gautier et al. 2013; thesis 2.6.6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate

from .elimination import Elimination
from .method import Method, Problem, Progress

__all__ = ["Gautier2013", "degrees_of_infeasibility"]

Vector = npt.NDArray[np.float64]

LEAST_SINGULAR_VALUE = 1e-10
"""Smaller ones, relative to the largest, count as zero."""


@dataclass(frozen=True)
class Gautier2013(Method):
    """Standard parameters as near as possible to those of CAD, along the directions that the data shows well.

    1. Base parameters are taken out one after the other, that of the largest relative standard deviation first, until
       the largest one is at most `largest_ratio` times the smallest one (Pham and Gautier 1991). The n_e that are left
       are the essential parameters.
    2. In the standard parameters that take part in them, the regression W K has n_e singular values worth having:
       δ = δ̂ + V₁ Σ₁⁻¹ U₁ᵀ (ω - W K δ̂), which of all δ with that torque is the one closest to the prior δ̂: that given
       to `fit`, zero where it is unknown, or that of the robot's description.

    The answer is a least squares solution: whether it is feasible is a matter of luck and of a prior well within the
    feasible set. The remarks give the degree of infeasibility: what must be added to the diagonal of a link's matrix
    before its Cholesky factorisation succeeds.

    Parameters
    ----------
    largest_ratio : float
        Between 10 and 30 in the papers, the larger the less noise there is; infinite keeps all base parameters.
    closest : {"absolute", "relative"}
        In which sense closest: in SI units, or relative to the size of each parameter of the prior (a parameter that is
        zero there stays zero).

    References
    ----------
    C. M. Pham, M. Gautier, Essential parameters of robots, IEEE Conference on Decision and Control, 1991.
    M. Gautier, S. Briot, G. Venture, Identification of consistent standard dynamic parameters of industrial robots,
    IEEE/ASME International Conference on Advanced Intelligent Mechatronics, 2013.

    Examples
    --------
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([(0, 0, 0, "q")], gravity=(0, -9.81, 0)))
    >>> information = sy.Information.from_factor(
    ...     10 * np.eye(3), [1.0, 5.0, 0.0], 0.02, 100, model.base_parameters().names
    ... )
    >>> prior = [0.2, 0, 0, 0.2, 0, 0.2, 0.4, 0, 0, 1.0]
    >>> estimate = Gautier2013().fit(information, sy.FeasibleSet(model), prior=prior)
    >>> estimate.parameters.round(6).tolist()
    [0.2, 0.0, 0.0, 0.2, 0.0, 0.1, 0.5, 0.0, 0.0, 1.0]
    >>> print(estimate.remarks[1])
    Degree of infeasibility: 0.165 (body of link1).
    """

    largest_ratio: float = 30.0
    closest: Literal["absolute", "relative"] = "absolute"

    name: ClassVar[str] = "Gautier et al. 2013"
    source: ClassVar[str] = (
        "M. Gautier, S. Briot, G. Venture, Identification of consistent standard dynamic parameters of industrial "
        "robots, IEEE/ASME International Conference on Advanced Intelligent Mechatronics, 2013."
    )

    def __post_init__(self) -> None:
        if not self.largest_ratio > 1.0:
            raise InputError(f"largest_ratio must be above 1, such as 30, got {self.largest_ratio!r}.")
        if self.closest not in ("absolute", "relative"):
            raise InputError(f'closest must be "absolute" or "relative", got {self.closest!r}.')

    def essential(self, problem: Problem, progress: Progress | None = None) -> Elimination:
        """Return the elimination that has the essential parameters left.

        Parameters
        ----------
        problem : Problem
        progress : callable, optional
        """
        elimination = Elimination(problem)
        while len(elimination.kept) > 1:
            deviations = elimination.relative_standard_deviation
            if deviations.max() <= self.largest_ratio * deviations.min():
                break
            elimination.remove_weakest()
            if progress is not None:
                progress(f"{len(elimination.kept)} parameters left")
        return elimination

    def _fit(self, problem: Problem, prior: Vector | None, progress: Progress | None) -> Estimate:
        remarks = []
        known = prior
        if known is None:
            known = np.asarray(problem.feasible_set.model.robot.parameters, dtype=np.float64)
        if not np.any(np.isfinite(known)):
            remarks.append("No prior is known, so the answer is the one closest to zero.")
        reference = np.nan_to_num(known)
        if self.closest == "relative" and not np.any(reference):
            raise InputError('closest="relative" needs a prior; give prior=, the standard parameters of CAD.')
        elimination = self.essential(problem, progress)
        parameters = self._near(problem, elimination, reference)
        names = problem.information.base_expressions
        excluded = [names[index] for index in elimination.removed]
        if excluded:
            remarks.append(f"Not essential: {'; '.join(excluded)}.")
        degrees = degrees_of_infeasibility(problem.feasible_set, parameters)
        if degrees:
            worst, (block, *_) = max(degrees.values()), sorted(degrees, key=lambda name: -degrees[name])
            remarks.append(f"Degree of infeasibility: {worst:.3g} ({block}).")
        note = f"{len(elimination.kept)} essential of {len(names)} base parameters"
        return problem.estimate(f"{self.name}: {note}", parameters, remarks=remarks)

    def _near(self, problem: Problem, elimination: Elimination, reference: Vector) -> Vector:
        """δ closest to the reference, by as many singular values as there are essential parameters."""
        takes_part = np.any(problem.feasible_set.K[elimination.kept] != 0.0, axis=0)
        scale = np.where(takes_part, np.abs(reference) if self.closest == "relative" else 1.0, 0.0)
        left, values, right = np.linalg.svd(problem.matrix * scale, full_matrices=False)
        count = min(len(elimination.kept), int(np.sum(values > LEAST_SINGULAR_VALUE * values.max(initial=0.0))))
        error = problem.rho - problem.matrix @ reference
        return np.asarray(reference + scale * (right[:count].T @ ((left[:, :count].T @ error) / values[:count])))


def degrees_of_infeasibility(feasible_set: FeasibleSet, parameters: npt.ArrayLike) -> dict[str, float]:
    """Return what must be added to the diagonal of each block before it is positive semidefinite, where that is not 0.

    Parameters
    ----------
    feasible_set : FeasibleSet
    parameters : (n,)

    Returns
    -------
    dict from the name of a block to the amount
    """
    eigenvalues = feasible_set.stack.smallest_eigenvalues(feasible_set.as_parameters(parameters))
    pairs = zip(feasible_set.blocks, eigenvalues, strict=True)
    return {block.name: -float(smallest) for block, smallest in pairs if smallest < 0.0}
