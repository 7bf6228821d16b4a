"""The base class of the methods over factors of inertias: their settings, and the descent from the prior."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate

from .factored_fit import FACTORED_SOLVERS, FactoredFit, FactoredSolver
from .method import Method, Problem, Progress, require_choice, require_positive
from .starting_point import starting_point

__all__ = ["FactoredMethod"]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class FactoredMethod(Method):
    """Nonlinear least squares over a change of variables that keeps answers feasible; the subclasses are the methods.

    The descent starts at the prior.
    """

    solver: FactoredSolver = "newton"
    iterations: int = 1000
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        require_choice(self, "solver", FACTORED_SOLVERS)
        require_positive(self, "iterations", "tolerance")

    def _fit(self, problem: Problem, prior: Vector | None, progress: Progress | None) -> Estimate:
        problem.refuse_constraints(self.name)
        descent = self._descent(problem, progress)
        start = starting_point(problem, prior)
        outcome = descent.solve(start, self.solver, self.iterations, self.tolerance, progress)
        parameters = self._answer(problem.feasible_set, outcome.parameters, start)
        return problem.estimate(self.name, parameters, remarks=[outcome.sentence()])

    @abstractmethod
    def _descent(self, problem: Problem, progress: Progress | None) -> FactoredFit:
        """Return the problem in the method's variables."""

    def _answer(self, feasible_set: FeasibleSet, parameters: Vector, start: Vector) -> Vector:
        """Return the parameters of the estimate, from where the descent ended and began."""
        return parameters
