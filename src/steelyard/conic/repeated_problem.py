"""One conic problem that is solved for many linear objectives, without setting up the solver anew."""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from .clarabel_solver import clarabel_cone, clarabel_outcome, clarabel_settings
from .problem import ConicProblem, Outcome
from .solver import solve

__all__ = ["RepeatedProblem"]

Vector = npt.NDArray[np.float64]


class RepeatedProblem:
    """A problem in suitable units that is solved for many linear objectives.

    Parameters
    ----------
    problem : ConicProblem
        Without a quadratic objective; its linear objective is ignored.
    solver : str
        As in `steelyard.conic.solve`. Clarabel keeps the problem and makes one attempt for each objective; other
        solvers get the whole problem each time.
    accuracy : float
        As in `steelyard.conic.solve`.
    """

    def __init__(self, problem: ConicProblem, solver: str, accuracy: float) -> None:
        self.problem = problem
        self.solver = solver
        self.accuracy = accuracy

    def solve(self, objective: Vector) -> tuple[Outcome, Vector, Vector]:
        """Minimise objective · x; return the outcome, the point x and the dual point z."""
        problem = self.problem
        if self.solver != "clarabel":
            changed = replace(problem, q=objective)
            solution = solve(changed, accuracy=self.accuracy, solver=self.solver)
            return solution.outcome, solution.primal, solution.dual
        self._clarabel.update(q=objective)
        found = self._clarabel.solve()
        return clarabel_outcome(found), np.asarray(found.x), np.asarray(found.z)

    @cached_property
    def _clarabel(self) -> Any:
        """The solver object of Clarabel that holds the problem."""
        import clarabel

        settings = clarabel_settings(self.accuracy)
        settings.direct_solve_method = "auto"
        problem = self.problem
        # Clarabel reads the classic matrix classes of SciPy.
        P, A = sparse.csc_matrix(problem.P), sparse.csc_matrix(problem.A)
        cones = [clarabel_cone(cone) for cone in problem.cones if cone.size]
        return clarabel.DefaultSolver(P, problem.q, A, problem.b, cones, settings)
