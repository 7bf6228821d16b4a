"""Clarabel, an interior-point method, called without a modelling layer; it keeps a problem for many objectives."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.once import cached_property

from .problem import Cone, ConicProblem, ConicSolution, Outcome, infeasibility_error, optimality_error
from .scaling import Scaling, equilibrate, scaling_around
from .solver import FEATURES, Solver, solve

__all__ = ["CLARABEL", "ClarabelProblem", "RepeatedProblem", "clarabel_settings", "solve_with_clarabel"]

_OUTCOMES = {
    "Solved": Outcome.SOLVED,
    "AlmostSolved": Outcome.ALMOST_SOLVED,
    "PrimalInfeasible": Outcome.INFEASIBLE,
    "AlmostPrimalInfeasible": Outcome.INFEASIBLE,
    "DualInfeasible": Outcome.UNBOUNDED,
    "AlmostDualInfeasible": Outcome.UNBOUNDED,
}

_UNFINISHED = (Outcome.ALMOST_SOLVED, Outcome.STOPPED)


@dataclass(frozen=True)
class _Attempt:
    """One way to solve a problem: the floor of `scaling_around`, or None for `equilibrate`; settings of Clarabel."""

    floor: float | None
    own_scaling: bool = True
    regularisation: float = 1e-8
    longest_step: float = 0.99


_CAREFUL = _Attempt(None, own_scaling=False, regularisation=1e-7, longest_step=0.9)
"""The first attempt at a problem with many solutions. Of 31 problems of masses that may grow, of random arms and the
WAM, all end with it; in the usual order 7 of them took four to six attempts, and all together three times as long."""

_ATTEMPTS: tuple[_Attempt, ...] = (
    _Attempt(None),
    _Attempt(1e-4),
    _Attempt(None, regularisation=1e-10),
    _Attempt(1e-4, own_scaling=False),
    _Attempt(1e-2),
    _CAREFUL,
    _Attempt(1e-2, own_scaling=False, regularisation=1e-7),
    _Attempt(1e-6, regularisation=1e-10, longest_step=0.9),
)
"""The attempts, made in this order until one ends with the plain status "Solved", and its errors are as small in the
units of the first attempt.

Of 633 problems from the thesis, the real WAM and random robots, 597 end so without any scaling, 622 in the
units of `equilibrate`, and all with these attempts. Of 337 problems with links up to a million times heavier than
others the counts are 168, 247 and 335."""

DOUBT = 20.0
"""A later attempt counts as solved if its error, in the units of the first attempt, is at most this many times the
accuracy: a tolerance that is met in one set of units is not met exactly in another."""


_LARGE_CONE, _FEW_ELEMENTS = 20, 0.25
"""Order of a semidefinite cone from which on it is decomposed, where no larger part of its elements can be nonzero.

The distance from base parameters of the thesis's arm (thesis 3.40) as a linear matrix inequality is an arrow of order
77 with 5 % of its elements: 0.04 s and 26 iterations in place of 26 s and 67. Blocks of links are of order 6 at most.
Later attempts do without, so that a pattern with which the decomposition fails costs one attempt."""

WEAK_PROOF = 1e-3
"""A proof of infeasibility is doubted if Aᵀz, scaled to bᵀz = -1, exceeds this divided by the largest element of b: a
point as large as b could then satisfy what z refutes."""


def solve_with_clarabel(problem: ConicProblem, accuracy: float = 1e-8, iterations: int = 200) -> ConicSolution:
    """Solve a conic problem with Clarabel (Goulart and Chen, 2024), in units in which it is well conditioned.

    If the solver ends before it reaches the accuracy, the problem is scaled around the point that it found and solved
    again.

    Parameters
    ----------
    accuracy : float
        Tolerance on the duality gap (absolute and relative) and on both feasibilities.
    iterations : int
        Most iterations to take in one attempt.

    Returns
    -------
    ConicSolution
        Its iterations and seconds are those of all attempts together.
    """
    best = _attempts(problem, accuracy, iterations)
    if best.outcome is not Outcome.INFEASIBLE:
        return best
    # Aᵀz is not exactly zero, so z proves nothing about points of the size of a large b: solve in units of b.
    size = float(np.abs(problem.b).max(initial=0.0))
    if size <= 1.0 or infeasibility_error(problem, best.dual) * size <= WEAK_PROOF:
        return best
    smaller = ConicProblem(problem.P, problem.q / size, problem.A, problem.b / size, problem.cones)
    found = _attempts(smaller, accuracy, iterations)
    return replace(
        found,
        primal=size * found.primal,
        slack=size * found.slack,
        dual=size * found.dual,
        objective=size * (size * found.objective),
        iterations=best.iterations + found.iterations,
        seconds=best.seconds + found.seconds,
    )


def _attempts(problem: ConicProblem, accuracy: float, iterations: int) -> ConicSolution:
    """Make the attempts in turn, and return the point with the smallest error."""
    if problem.balanced:
        found = _run(problem, None, _ATTEMPTS[0], accuracy, iterations, split=_falls_apart(problem))
        if found.outcome not in _UNFINISHED:
            return found
        problem = replace(problem, balanced=False)
    balance = equilibrate(problem)
    attempts = _ATTEMPTS
    if problem.degenerate:
        attempts = (_CAREFUL, *(attempt for attempt in _ATTEMPTS if attempt is not _CAREFUL))
    found = _run(problem, balance, attempts[0], accuracy, iterations, split=_falls_apart(problem))
    if found.outcome not in _UNFINISHED:
        return found
    balanced = balance.apply(problem.symmetric)
    best, least = found, optimality_error(balanced, *balance.into(found))
    taken, seconds = found.iterations, found.seconds
    for attempt in attempts[1:]:
        scaling = balance
        if attempt.floor is not None and np.all(np.isfinite(best.slack)):
            around = scaling_around(problem, best.slack, attempt.floor)
            scaling = around.then(equilibrate(around.apply(problem)))
        found = _run(problem, scaling, attempt, accuracy, iterations)
        taken, seconds = taken + found.iterations, seconds + found.seconds
        if found.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED):
            # If an earlier attempt came close to a solution, a later claim that there is none is not believed.
            if best.outcome is Outcome.STOPPED:
                best = found
                break
            continue
        error = optimality_error(balanced, *balance.into(found))
        if found.outcome is Outcome.SOLVED and error > DOUBT * accuracy:
            found = replace(found, outcome=Outcome.ALMOST_SOLVED)
        if (found.outcome is Outcome.SOLVED) or error < least:
            best, least = found, error
        if best.outcome is Outcome.SOLVED:
            break
    return replace(best, iterations=taken, seconds=seconds)


def clarabel_settings(accuracy: float) -> Any:
    """Return settings of a quiet run on one thread, without presolving and chordal decomposition.

    Either of the two would forbid changing the objective afterwards, as `ClarabelProblem.solve` does. Problems that are
    solved once are decomposed where it pays.
    """
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    return settings


def _clarabel_cone(cone: Cone) -> Any:
    """Return the object of the package clarabel for a cone."""
    import clarabel

    if cone.kind == "exponential":
        return clarabel.ExponentialConeT()
    kinds = {
        "zero": clarabel.ZeroConeT,
        "nonnegative": clarabel.NonnegativeConeT,
        "second-order": clarabel.SecondOrderConeT,
        "semidefinite": clarabel.PSDTriangleConeT,
    }
    return kinds[cone.kind](cone.size)


class ClarabelProblem:
    """A problem that Clarabel holds, to be solved once or for several linear objectives.

    Parameters
    ----------
    problem : ConicProblem
        Its P may be symmetric or upper triangular.
    settings : object
        As of `clarabel_settings`.
    """

    def __init__(self, problem: ConicProblem, settings: Any) -> None:
        self.problem, self.settings = problem, settings
        self._solver: Any = None

    def solve(self, objective: npt.NDArray[np.float64] | None = None) -> ConicSolution:
        """Solve the problem, with another linear objective in the place of q where one is given.

        Where Clarabel panics, the outcome is `STOPPED` and the numbers are NaN; the next call sets it up anew.
        """
        q = self.problem.q if objective is None else objective
        try:
            if self._solver is None:
                self._solver = self._set_up(q)
            elif objective is not None:
                self._solver.update(q=q)
            found = self._solver.solve()
        except BaseException as error:
            # A panic of its Rust code is no Exception, and has no class that could be imported.
            if type(error).__name__ != "PanicException":
                raise
            self._solver = None
            nowhere, rows = np.full(len(self.problem.q), np.nan), np.full(len(self.problem.b), np.nan)
            return ConicSolution(Outcome.STOPPED, "Panic", nowhere, rows, rows, np.nan, 0, 0.0, "Clarabel")
        return ConicSolution(
            outcome=_OUTCOMES.get(str(found.status), Outcome.STOPPED),
            status=str(found.status),
            primal=np.asarray(found.x),
            slack=np.asarray(found.s),
            dual=np.asarray(found.z),
            objective=float(found.obj_val),
            iterations=int(found.iterations),
            seconds=float(found.solve_time),
            solver="Clarabel",
        )

    def _set_up(self, q: npt.NDArray[np.float64]) -> Any:
        import clarabel

        problem = self.problem
        # Clarabel reads the classic matrix classes of SciPy, and of P the upper triangle.
        P = sparse.csc_matrix(problem.P if problem.balanced else sparse.triu(problem.P, format="csc"))
        A = sparse.csc_matrix(problem.A)
        cones = [_clarabel_cone(cone) for cone in problem.cones if cone.size]
        return clarabel.DefaultSolver(P, q, A, problem.b, cones, self.settings)


def _falls_apart(problem: ConicProblem) -> bool:
    """Return whether most elements of a large semidefinite cone are zero whatever the unknowns are.

    Clarabel then takes many small cones in its place (chordal decomposition).
    """
    if not any(cone.kind == "semidefinite" and cone.size >= _LARGE_CONE for cone in problem.cones):
        return False
    filled = (np.diff(sparse.csr_matrix(problem.A).indptr) > 0) | (problem.b != 0.0)
    begin = 0
    for cone in problem.cones:
        rows = slice(begin, begin + cone.rows)
        begin = rows.stop
        large = cone.kind == "semidefinite" and cone.size >= _LARGE_CONE
        if large and np.count_nonzero(filled[rows]) <= _FEW_ELEMENTS * cone.rows:
            return True
    return False


def _run(
    problem: ConicProblem,
    scaling: Scaling | None,
    attempt: _Attempt,
    accuracy: float,
    iterations: int,
    *,
    split: bool = False,
) -> ConicSolution:
    """Run Clarabel once, and return the answer in the units of the problem; `split` is for `_falls_apart`."""
    settings = clarabel_settings(accuracy)
    settings.chordal_decomposition_enable = split
    settings.max_iter = iterations
    settings.equilibrate_enable = attempt.own_scaling
    settings.static_regularization_constant = attempt.regularisation
    settings.max_step_fraction = attempt.longest_step
    solution = ClarabelProblem(problem if scaling is None else scaling.apply(problem), settings).solve()
    return solution if scaling is None else scaling.undo(solution)


def _version() -> str:
    import clarabel

    return str(clarabel.__version__)


CLARABEL = Solver(
    name="clarabel",
    title="Clarabel",
    description="interior point, default",
    run=solve_with_clarabel,
    native=frozenset(FEATURES),
    version=_version,
    remedy="pip install clarabel",
)


class RepeatedProblem:
    """A problem in suitable units that is solved for many linear objectives, without setting up the solver anew.

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

    def solve(self, objective: npt.NDArray[np.float64]) -> ConicSolution:
        """Minimise objective · x; look at the outcome of the answer, which may be `STOPPED` and without numbers."""
        if self.solver == "clarabel":
            return self._clarabel.solve(objective)
        return solve(replace(self.problem, q=objective), accuracy=self.accuracy, solver=self.solver)

    @cached_property
    def _clarabel(self) -> ClarabelProblem:
        settings = clarabel_settings(self.accuracy)
        settings.direct_solve_method = "auto"
        return ClarabelProblem(self.problem, settings)
