"""One conic problem of which only the linear objective changes, kept in the solver where the solver allows it."""

from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import ConicProblem, Outcome, solve

__all__ = ["RepeatedProblem"]

Vector = npt.NDArray[np.float64]


class RepeatedProblem:
    """A linear problem, already in good units, to be solved for many objectives.

    Parameters
    ----------
    problem : ConicProblem
        Without a quadratic objective; its linear objective is ignored.
    solver : str
        As in `steelyard.conic.solve`. Clarabel is kept with the problem in it, and tries once; others are
        handed the whole problem each time.
    accuracy : float
        As in `steelyard.conic.solve`.
    """

    def __init__(self, problem: ConicProblem, solver: str, accuracy: float) -> None:
        self.problem = problem
        self.solver = solver
        self.accuracy = accuracy

    def solve(self, objective: Vector) -> tuple[Outcome, Vector, Vector]:
        """How it ended, the point x, and the dual point z."""
        problem = self.problem
        if self.solver != "clarabel":
            changed = ConicProblem(problem.P, objective, problem.A, problem.b, problem.cones)
            solution = solve(changed, accuracy=self.accuracy, solver=self.solver)
            return solution.outcome, solution.primal, solution.dual
        self._clarabel.update(q=objective)
        found = self._clarabel.solve()
        return _OUTCOMES.get(str(found.status), Outcome.STOPPED), np.asarray(found.x), np.asarray(found.z)

    @cached_property
    def _clarabel(self) -> Any:
        """Clarabel with the problem in it."""
        import clarabel

        kinds = {
            "zero": clarabel.ZeroConeT,
            "nonnegative": clarabel.NonnegativeConeT,
            "second-order": clarabel.SecondOrderConeT,
            "semidefinite": clarabel.PSDTriangleConeT,
        }
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = self.accuracy
        # Only without these can the objective be changed afterwards.
        settings.presolve_enable = False
        settings.chordal_decomposition_enable = False
        settings.direct_solve_method = "auto"
        problem = self.problem
        # Clarabel reads the classic matrix classes of SciPy.
        P, A = sparse.csc_matrix(problem.P), sparse.csc_matrix(problem.A)
        cones = [kinds[cone.kind](cone.size) for cone in problem.cones if cone.size]
        return clarabel.DefaultSolver(P, problem.q, A, problem.b, cones, settings)


_OUTCOMES = {
    "Solved": Outcome.SOLVED,
    "AlmostSolved": Outcome.ALMOST_SOLVED,
    "DualInfeasible": Outcome.UNBOUNDED,
    "AlmostDualInfeasible": Outcome.UNBOUNDED,
}
