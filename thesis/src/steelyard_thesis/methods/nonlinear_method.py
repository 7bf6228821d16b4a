"""The base class of the methods over standard parameters: settings, and the search under nonlinear conditions."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from steelyard.regression import Estimate

from .link_conditions import LinkConditions
from .method import Method, Problem, Progress, Vector, require_choice, require_positive
from .nonlinear_program import NonlinearProgram
from .nonlinear_solvers import SOLVERS, SolverName, solve_program
from .starting_point import starting_point

__all__ = ["NonlinearMethod"]


@dataclass(frozen=True)
class NonlinearMethod(Method):
    """Regression over standard parameters under nonlinear conditions (thesis 2.69); the subclasses are the methods."""

    solver: SolverName = "slsqp"
    iterations: int = 1000
    tolerance: float = 1e-9
    residual_weight: float = 1.0
    prior_weight: float = 0.0
    triangle_inequality: bool = False

    def __post_init__(self) -> None:
        require_choice(self, "solver", SOLVERS)
        require_positive(self, "iterations", "tolerance", "residual_weight", zero=["prior_weight"])

    def _fit(self, problem: Problem, prior: Vector | None, progress: Progress | None) -> Estimate:
        base = problem.least_squares if prior is None else problem.base_of(prior)
        conditions = self._conditions()
        remarks = []
        point = inside = starting_point(problem, prior)
        for step, condition in enumerate(conditions, 1):
            program = NonlinearProgram(
                problem,
                condition,
                residual_weight=self.residual_weight,
                prior_weight=self.prior_weight,
                prior_base=base,
                triangle=self.triangle_inequality,
            )
            last = step == len(conditions)
            outcome = solve_program(
                program, point, self.solver, self.iterations, self.tolerance, progress, inside, repair=last
            )
            point = outcome.parameters
            remarks.append(outcome.sentence(f"Step {step}" if len(conditions) > 1 else ""))
        title = f"{self.name}, with the triangle inequality" if self.triangle_inequality else self.name
        return problem.estimate(title, point, remarks=remarks)

    @abstractmethod
    def _conditions(self) -> list[LinkConditions]:
        """Return the conditions of each step; a step starts where the one before it ended."""
