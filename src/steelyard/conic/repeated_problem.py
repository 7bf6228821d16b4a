"""One conic problem that is solved for many linear objectives, without setting up the solver anew."""

from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .clarabel_solver import ClarabelProblem, clarabel_settings
from .problem import ConicProblem, ConicSolution
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

    def solve(self, objective: Vector) -> ConicSolution:
        """Minimise objective · x; look at the outcome of the answer, which may be `STOPPED` and without numbers."""
        if self.solver == "clarabel":
            return self._clarabel.solve(objective)
        return solve(replace(self.problem, q=objective), accuracy=self.accuracy, solver=self.solver)

    @cached_property
    def _clarabel(self) -> ClarabelProblem:
        settings = clarabel_settings(self.accuracy)
        settings.direct_solve_method = "auto"
        return ClarabelProblem(self.problem, settings)
