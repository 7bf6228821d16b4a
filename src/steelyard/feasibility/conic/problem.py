"""Conic problems, handed to Clarabel without a modelling layer in between."""

import enum
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import SolverError

__all__ = ["Cone", "ConicProblem", "ConicSolution", "Outcome", "solve"]

Vector = npt.NDArray[np.float64]


class Outcome(enum.Enum):
    """How a solver ended; the value is what to tell the user."""

    SOLVED = "solved"
    ALMOST_SOLVED = "solved to reduced accuracy"
    INFEASIBLE = "no point satisfies the constraints"
    UNBOUNDED = "the objective is unbounded"
    STOPPED = "stopped before the accuracy asked for was reached"

    @property
    def usable(self) -> bool:
        """Whether the point may be of use, once it has been verified."""
        return self in (Outcome.SOLVED, Outcome.ALMOST_SOLVED, Outcome.STOPPED)


@dataclass(frozen=True)
class Cone:
    """One cone of the product K: ``"zero"``, ``"nonnegative"``, ``"second-order"`` or ``"semidefinite"``.

    `size` is the number of rows, but for ``"semidefinite"``, where it is the order d of the matrix, whose upper
    triangle takes d (d + 1) / 2 rows, stacked by columns, off-diagonal elements times √2.

    Examples
    --------
    >>> Cone("semidefinite", 4).rows
    10
    """

    kind: str
    size: int

    @property
    def rows(self) -> int:
        """Rows that the cone takes."""
        return self.size * (self.size + 1) // 2 if self.kind == "semidefinite" else self.size


@dataclass(frozen=True, eq=False)
class ConicProblem:
    """Minimise ½ xᵀP x + qᵀx subject to A x + s = b, s in K.

    Attributes
    ----------
    P : (n, n) sparse, symmetric (its upper triangle is used), positive semidefinite
    q : (n,)
    A : (rows, n) sparse
    b : (rows,)
    cones : tuple of Cone, in the order of the rows
    """

    P: sparse.csc_array
    q: Vector
    A: sparse.csc_array
    b: Vector
    cones: tuple[Cone, ...]


@dataclass(frozen=True, eq=False)
class ConicSolution:
    """What the solver found.

    Attributes
    ----------
    outcome : Outcome
    status : str
        The solver's own word.
    primal : (n,)
        x.
    slack : (rows,)
        s.
    dual : (rows,)
        z, in the dual cone. For `Outcome.INFEASIBLE` a direction that proves it: Aᵀz = 0, bᵀz < 0.
    objective : float
    iterations : int
    seconds : float
    """

    outcome: Outcome
    status: str
    primal: Vector = field(repr=False)
    slack: Vector = field(repr=False)
    dual: Vector = field(repr=False)
    objective: float
    iterations: int
    seconds: float

    def require(self, purpose: str) -> "ConicSolution":
        """Return itself if the point may be used, else raise.

        Raises
        ------
        SolverError
            Names what was computed, the status and the remedy.
        """
        if self.outcome.usable and bool(np.all(np.isfinite(self.primal))):
            return self
        raise SolverError(
            f"Clarabel could not {purpose}: {self.outcome.value} (status {self.status}, {self.iterations} iterations); "
            "check that the constraints do not contradict each other and that units are SI."
        )


_OUTCOMES = {
    "Solved": Outcome.SOLVED,
    "AlmostSolved": Outcome.ALMOST_SOLVED,
    "PrimalInfeasible": Outcome.INFEASIBLE,
    "AlmostPrimalInfeasible": Outcome.INFEASIBLE,
    "DualInfeasible": Outcome.UNBOUNDED,
    "AlmostDualInfeasible": Outcome.UNBOUNDED,
}


def solve(problem: ConicProblem, accuracy: float = 1e-8, iterations: int = 200) -> ConicSolution:
    """Solve a conic problem with Clarabel.

    Parameters
    ----------
    problem : ConicProblem
    accuracy : float
        Tolerance on the duality gap (absolute and relative) and on both feasibilities.
    iterations : int
        Most iterations to take.

    Returns
    -------
    ConicSolution
        Also when nothing was found: look at its `outcome`, or call its `require`.

    Examples
    --------
    The smallest x with [[x, 1], [1, x]] positive semidefinite:

    >>> A = sparse.csc_array(np.array([[-1.0], [0.0], [-1.0]]))
    >>> b = np.array([0.0, 2**0.5, 0.0])
    >>> problem = ConicProblem(sparse.csc_array((1, 1)), np.ones(1), A, b, (Cone("semidefinite", 2),))
    >>> solution = solve(problem)
    >>> solution.outcome, round(solution.objective, 6)
    (<Outcome.SOLVED: 'solved'>, 1.0)
    """
    import clarabel

    kinds = {
        "zero": clarabel.ZeroConeT,
        "nonnegative": clarabel.NonnegativeConeT,
        "second-order": clarabel.SecondOrderConeT,
        "semidefinite": clarabel.PSDTriangleConeT,
    }
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = iterations
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    # Clarabel reads the classic matrix classes of SciPy.
    P = sparse.csc_matrix(sparse.triu(problem.P, format="csc"))
    A = sparse.csc_matrix(problem.A)
    cones = [kinds[cone.kind](cone.size) for cone in problem.cones if cone.size]
    solver = clarabel.DefaultSolver(P, problem.q, A, problem.b, cones, settings)
    found = solver.solve()
    status = str(found.status)
    return ConicSolution(
        outcome=_OUTCOMES.get(status, Outcome.STOPPED),
        status=status,
        primal=np.asarray(found.x),
        slack=np.asarray(found.s),
        dual=np.asarray(found.z),
        objective=float(found.obj_val),
        iterations=int(found.iterations),
        seconds=float(found.solve_time),
    )
