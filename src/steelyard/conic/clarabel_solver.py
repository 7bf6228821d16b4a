"""Clarabel: an interior-point method in memory, without a modelling layer in between."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sparse

from .accuracy import infeasibility_error, optimality_error
from .problem import Cone, ConicProblem, ConicSolution, Outcome
from .scaling import Scaling, equilibrate, scaling_around
from .solver import FEATURES, Solver

__all__ = ["CLARABEL", "clarabel_cone", "clarabel_outcome", "clarabel_settings", "solve_with_clarabel"]

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
    """How to try: units around the point found (see `scaling_around`), and three settings of Clarabel."""

    floor: float | None
    own_scaling: bool = True
    regularisation: float = 1e-8
    longest_step: float = 0.99


_ATTEMPTS = (
    _Attempt(None),
    _Attempt(1e-4),
    _Attempt(None, regularisation=1e-10),
    _Attempt(1e-4, own_scaling=False),
    _Attempt(1e-2),
    _Attempt(None, own_scaling=False, regularisation=1e-7, longest_step=0.9),
    _Attempt(1e-2, own_scaling=False, regularisation=1e-7),
    _Attempt(1e-6, regularisation=1e-10, longest_step=0.9),
)
"""What is tried, one after the other, until the status is a plain "Solved" that holds in the units of the first.

Of 633 problems from the thesis, the real WAM and random robots 597 end so as they are, 622 in the units of
`equilibrate` and all with these attempts; of 337 with links up to a million times heavier than others 168, 247 and
335."""

DOUBT = 20.0
"""Multiple of the accuracy that the error, in the units of the first attempt, may have in those of a later one."""


WEAK_PROOF = 1e-3
"""A proof of infeasibility is doubted where Aᵀz, for bᵀz = -1, exceeds this divided by the largest element of b."""


def solve_with_clarabel(problem: ConicProblem, accuracy: float = 1e-8, iterations: int = 200) -> ConicSolution:
    """Solve a conic problem with Clarabel (Goulart and Chen, 2024), in units in which it is well conditioned.

    Where the solver ends with less than the accuracy asked for, the problem is put in units of the point that it
    found, and solved again.

    Parameters
    ----------
    problem : ConicProblem
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
    # Aᵀz is not exactly zero, so that z says nothing of points far out: where b is large, look there.
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
        objective=size**2 * found.objective,
        iterations=best.iterations + found.iterations,
        seconds=best.seconds + found.seconds,
    )


def _attempts(problem: ConicProblem, accuracy: float, iterations: int) -> ConicSolution:
    """One attempt after the other; the point with the least error."""
    if problem.balanced:
        found = _run(problem, None, _ATTEMPTS[0], accuracy, iterations)
        if found.outcome not in _UNFINISHED:
            return found
        problem = replace(problem, balanced=False)
    balance = equilibrate(problem)
    found = _run(problem, balance, _ATTEMPTS[0], accuracy, iterations)
    if found.outcome not in _UNFINISHED:
        return found
    balanced = balance.apply(problem.symmetric)
    best, least = found, _error(balanced, balance, found)
    taken, seconds = found.iterations, found.seconds
    for attempt in _ATTEMPTS[1:]:
        scaling = balance
        if attempt.floor is not None and np.all(np.isfinite(best.slack)):
            around = scaling_around(problem, best.slack, attempt.floor)
            scaling = around.then(equilibrate(around.apply(problem)))
        found = _run(problem, scaling, attempt, accuracy, iterations)
        taken, seconds = taken + found.iterations, seconds + found.seconds
        if found.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED):
            # The first attempt came near a point; only where it came nowhere is this to be believed.
            if best.outcome is Outcome.STOPPED:
                best = found
                break
            continue
        error = _error(balanced, balance, found)
        if found.outcome is Outcome.SOLVED and error > DOUBT * accuracy:
            found = replace(found, outcome=Outcome.ALMOST_SOLVED)
        if (found.outcome is Outcome.SOLVED) or error < least:
            best, least = found, error
        if best.outcome is Outcome.SOLVED:
            break
    return replace(best, iterations=taken, seconds=seconds)


def _error(balanced: ConicProblem, balance: Scaling, found: ConicSolution) -> float:
    """How far a point is from optimal, in the units of the first attempt."""
    primal, slack, dual = found.primal / balance.columns, found.slack * balance.rows, found.dual / balance.rows
    return optimality_error(balanced, primal, slack, dual)


def clarabel_outcome(found: Any) -> Outcome:
    """How a run of Clarabel ended."""
    return _OUTCOMES.get(str(found.status), Outcome.STOPPED)


def clarabel_settings(accuracy: float) -> Any:
    """Settings of a quiet run on one thread that leaves the problem as it is.

    Only without presolving and decomposition can the objective be changed afterwards.
    """
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    return settings


def clarabel_cone(cone: Cone) -> Any:
    """Clarabel's own object."""
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


def _run(
    problem: ConicProblem, scaling: Scaling | None, attempt: _Attempt, accuracy: float, iterations: int
) -> ConicSolution:
    """One run, its answer in the units of the problem."""
    import clarabel

    settings = clarabel_settings(accuracy)
    settings.max_iter = iterations
    settings.equilibrate_enable = attempt.own_scaling
    settings.static_regularization_constant = attempt.regularisation
    settings.max_step_fraction = attempt.longest_step
    scaled = problem if scaling is None else scaling.apply(problem)
    # Clarabel reads the classic matrix classes of SciPy.
    P = sparse.csc_matrix(scaled.P if problem.balanced else sparse.triu(scaled.P, format="csc"))
    A = sparse.csc_matrix(scaled.A)
    cones = [clarabel_cone(cone) for cone in problem.cones if cone.size]
    try:
        found = clarabel.DefaultSolver(P, scaled.q, A, scaled.b, cones, settings).solve()
    except BaseException as error:
        # A panic of its Rust code is no Exception, and has no class that could be imported.
        if type(error).__name__ != "PanicException":
            raise
        nowhere, rows = np.full(len(problem.q), np.nan), np.full(len(problem.b), np.nan)
        return ConicSolution(Outcome.STOPPED, "Panic", nowhere, rows, rows, np.nan, 0, 0.0, "Clarabel")
    solution = ConicSolution(
        outcome=clarabel_outcome(found),
        status=str(found.status),
        primal=np.asarray(found.x),
        slack=np.asarray(found.s),
        dual=np.asarray(found.z),
        objective=float(found.obj_val),
        iterations=int(found.iterations),
        seconds=float(found.solve_time),
        solver="Clarabel",
    )
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
