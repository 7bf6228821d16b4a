"""What the methods over factors of inertias share: settings, and the descent from the prior."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from steelyard.dynamics.threads import one_thread
from steelyard.feasibility import FeasibleSet
from steelyard.regression import Estimate, Information

from .factored_fit import FACTORED_SOLVERS, FactoredFit, FactoredSolver
from .method import Problem, Progress, Weights, require_choice, require_positive
from .starting_point import starting_point

__all__ = ["FactoredMethod"]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class FactoredMethod(ABC):
    """Nonlinear least squares over a change of variables that every feasible answer has; see the methods themselves."""

    name: ClassVar[str]
    source: ClassVar[str]

    solver: FactoredSolver = "newton"
    iterations: int = 1000
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        require_choice(self, "solver", FACTORED_SOLVERS)
        require_positive(self, "iterations", "tolerance")

    def fit(
        self,
        information: Information,
        feasible: FeasibleSet,
        *,
        weights: Weights = "joint",
        prior: npt.ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> Estimate:
        """Identify; see `Method.fit`. The prior is where the descent starts."""
        problem = Problem.of(information, feasible, weights)
        problem.refuse_constraints(self.name)
        with one_thread():
            descent = self._descent(problem, progress)
            start = starting_point(problem, problem.as_prior(prior))
            outcome = descent.solve(start, self.solver, self.iterations, self.tolerance, progress)
            parameters = self._answer(feasible, outcome.parameters, start)
        return problem.estimate(self.name, parameters, remarks=[outcome.sentence()])

    @abstractmethod
    def _descent(self, problem: Problem, progress: Progress | None) -> FactoredFit:
        """Return the problem in the method's variables."""

    def _answer(self, feasible: FeasibleSet, parameters: Vector, start: Vector) -> Vector:
        """Return the parameters of the estimate, from where the descent ended and began."""
        return parameters
