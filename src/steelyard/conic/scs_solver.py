"""SCS, a first-order method: many cheap iterations, moderate accuracy."""

import itertools
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from .problem import (
    Cone,
    ConicProblem,
    ConicSolution,
    Outcome,
    infeasibility_error,
    optimality_error,
    recession_error,
    stacked_triangle,
)
from .scaling import Scaling, equilibrate, scaling_around
from .solver import FEATURES, Solver

__all__ = ["SCS", "solve_with_scs"]

Indices = npt.NDArray[np.intp]
Vector = npt.NDArray[np.float64]

ITERATIONS_FOR_ONE = 1000
"""Iterations of SCS that are allowed for each iteration of an interior-point method."""

FIRST_LENGTH, GROWTH, MOST_RESTARTS = 1000, 1.3, 60
"""Iterations until the first restart, the factor by which each next run is longer, and the largest number of runs.
Short first runs find the sizes of the solution; longer runs later let the method converge in the units that follow from
them."""

FLOORS = (1e-4, 1e-2, 1e-6)
"""The floors of `scaling_around` in the restarts, in turn: small floors suit links of very different masses, large ones
a point that is still far from the solution."""

PROOF_ERROR = 1e-4
"""Largest error of a direction that counts as a proof that no point exists, or that the objective is unbounded. It is
larger than for the external programs because a first-order method converges slowly to such a direction."""

_OUTCOMES = {
    "solved": Outcome.SOLVED,
    "solved (inaccurate": Outcome.ALMOST_SOLVED,
    "infeasible": Outcome.INFEASIBLE,
    "infeasible (inaccurate": Outcome.INFEASIBLE,
    "unbounded": Outcome.UNBOUNDED,
    "unbounded (inaccurate": Outcome.UNBOUNDED,
}


def solve_with_scs(problem: ConicProblem, accuracy: float = 1e-8, iterations: int = 200) -> ConicSolution:
    """Solve a conic problem with SCS (O'Donoghue, 2021), restarted in units of the point found so far.

    A first-order method is slow on badly conditioned problems. So after some iterations the problem is scaled such that
    the slack found so far has ones on its diagonal, and the method continues from there.

    Parameters
    ----------
    accuracy : float
        Tolerance, absolute and relative, on the residuals and on the duality gap.
    iterations : int
        Largest number of iterations, in thousands.

    Returns
    -------
    ConicSolution
        With `Outcome.ALMOST_SOLVED` if the iterations ended before the tolerance was met.
    """
    if 0 in problem.A.shape:
        return _without_padding(solve_with_scs(_padded(problem), accuracy, iterations), problem)
    balance = equilibrate(problem)
    balanced = balance.apply(problem.symmetric)
    arrangement = _arrangement(problem.cones)
    scaling = balance
    start: tuple[Vector, Vector, Vector] | None = None
    taken, seconds, length, most = 0, 0.0, float(FIRST_LENGTH), iterations * ITERATIONS_FOR_ONE
    best: ConicSolution | None = None
    least = np.inf
    for floor in itertools.islice(itertools.cycle(FLOORS), MOST_RESTARTS):
        found = scaling.undo(_run(scaling.apply(problem), arrangement, accuracy, min(int(length), most - taken), start))
        taken, seconds = taken + found.iterations, seconds + found.seconds
        if found.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED):
            if _proves(balanced, balance, found):
                return replace(found, iterations=taken, seconds=seconds)
            found = replace(found, outcome=Outcome.STOPPED)
        if found.outcome is Outcome.STOPPED:
            best = best or found
            break
        error = optimality_error(balanced, *balance.into(found))
        if best is None or error < least:
            best, least = found, error
        if taken >= most or (found.outcome is Outcome.SOLVED and error <= 10 * accuracy):
            break
        scaling = scaling_around(problem, found.slack, floor)
        start = scaling.into(found)
        length *= GROWTH
    assert best is not None
    outcome = best.outcome
    if outcome in (Outcome.SOLVED, Outcome.ALMOST_SOLVED):
        outcome = Outcome.SOLVED if least <= 10 * accuracy else Outcome.ALMOST_SOLVED
    return replace(best, outcome=outcome, iterations=taken, seconds=seconds)


def _proves(balanced: ConicProblem, balance: Scaling, found: ConicSolution) -> bool:
    """Return whether a direction that SCS returned is a proof of infeasibility or unboundedness."""
    primal, _, dual = balance.into(found)
    if found.outcome is Outcome.INFEASIBLE:
        return infeasibility_error(balanced, dual) <= PROOF_ERROR
    return recession_error(balanced, primal) <= PROOF_ERROR


def _padded(problem: ConicProblem) -> ConicProblem:
    """The problem with one more unknown and row without effect, since SCS refuses problems without any."""
    last = sparse.csc_array(np.eye(1))
    return ConicProblem(
        P=sparse.csc_array(sparse.block_diag([problem.P, last])),
        q=np.append(problem.q, 0.0),
        A=sparse.csc_array(sparse.block_diag([problem.A, last])),
        b=np.append(problem.b, 1.0),
        cones=(*problem.cones, Cone("nonnegative", 1)),
    )


def _without_padding(solution: ConicSolution, problem: ConicProblem) -> ConicSolution:
    """The solution without the unknown and the row that `_padded` added."""
    rows, count = problem.A.shape
    return replace(solution, primal=solution.primal[:count], slack=solution.slack[:rows], dual=solution.dual[:rows])


def _run(
    problem: ConicProblem,
    arrangement: tuple[Indices, dict[str, Any]],
    accuracy: float,
    most: int,
    start: tuple[Vector, Vector, Vector] | None,
) -> ConicSolution:
    """Run SCS for at most `most` iterations, from `start` = (x, s, z) if given."""
    import scs

    order, sizes = arrangement
    data = {
        "P": sparse.csc_matrix(sparse.triu(problem.P, format="csc")),
        "A": sparse.csc_matrix(sparse.csr_array(problem.A)[order]),
        "b": problem.b[order],
        "c": problem.q,
    }
    workspace = scs.SCS(data, sizes, eps_abs=accuracy, eps_rel=accuracy, max_iters=most, verbose=False)
    if start is None:
        found = workspace.solve()
    else:
        primal, slack, dual = start
        found = workspace.solve(warm_start=True, x=primal, s=slack[order], y=dual[order])
    info = found["info"]
    status = str(info["status"])
    slack, dual = np.empty(len(order)), np.empty(len(order))
    slack[order], dual[order] = found["s"], found["y"]
    return ConicSolution(
        outcome=_OUTCOMES.get(status.partition(" - ")[0], Outcome.STOPPED),
        status=status,
        primal=np.asarray(found["x"]),
        slack=slack,
        dual=dual,
        objective=float(info["pobj"]),
        iterations=int(info["iter"]),
        seconds=1e-3 * float(info["setup_time"] + info["solve_time"]),
        solver="SCS",
    )


def _arrangement(cones: tuple[Cone, ...]) -> tuple[Indices, dict[str, Any]]:
    """The order of the rows for SCS, and its description of the cones.

    SCS expects the cones sorted by kind, and symmetric matrices as their lower triangle, stacked by columns.
    """
    rows: dict[str, list[Indices]] = {kind: [] for kind in _KINDS}
    sizes: dict[str, list[int]] = {kind: [] for kind in _KINDS}
    start = 0
    for cone in cones:
        if not cone.size:
            continue
        own = np.arange(start, start + cone.rows)
        start += cone.rows
        if cone.kind == "semidefinite":
            row, column, _ = stacked_triangle(cone.size)
            places = np.zeros((cone.size, cone.size), dtype=np.intp)
            places[column, row] = own
            upper = np.triu_indices(cone.size)
            own = places.T[upper]
        rows[cone.kind].append(own)
        sizes[cone.kind].append(cone.size)
    order = np.concatenate([np.zeros(0, dtype=np.intp), *(part for kind in _KINDS for part in rows[kind])])
    return order, {
        "z": sum(sizes["zero"]),
        "l": sum(sizes["nonnegative"]),
        "q": sizes["second-order"],
        "s": sizes["semidefinite"],
        "ep": len(sizes["exponential"]),
    }


_KINDS = ("zero", "nonnegative", "second-order", "semidefinite", "exponential")
"""The order in which SCS expects the cones."""


def _version() -> str:
    import scs

    return str(scs.__version__)


SCS = Solver(
    name="scs",
    title="SCS",
    description="first order",
    run=solve_with_scs,
    native=frozenset(FEATURES),
    installed=lambda: find_spec("scs") is not None,
    version=_version,
    remedy="pip install 'scs>=3.2.6'",
)
