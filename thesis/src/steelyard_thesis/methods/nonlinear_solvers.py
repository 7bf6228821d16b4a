"""General solvers for nonlinear programs: SLSQP and trust-constr of SciPy, and IPOPT where cyipopt is installed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import MissingExtraError

from .method import Progress
from .nonlinear_program import NonlinearProgram

__all__ = ["SOLVERS", "Outcome", "SolverName", "solve_program"]

Vector = npt.NDArray[np.float64]

BISECTIONS = 40  # of the way back inside: the place is then known to 1e-12 of the way

FLATTEST = 1e-4
"""Second derivatives below this part of the largest count as that for the units of SLSQP."""

BROKEN_DOWN = (4, 8)
"""SLSQP: "inequality constraints incompatible", "positive directional derivative for linesearch"."""

RESTART = 1e-4
"""Part by which the objective must have fallen to start it anew."""

INWARD = 1e-2
"""Part of the way back to the first point from which it does."""

SolverName = Literal["slsqp", "trust-constr", "ipopt"]
SOLVERS: tuple[SolverName, ...] = ("slsqp", "trust-constr", "ipopt")


@dataclass(frozen=True)
class Outcome:
    """The result of a solver.

    Attributes
    ----------
    parameters : (n,)
        The last iterate, moved inside the conditions where it violates them, or the best one before that was inside;
        an iterate outside only where none was inside.
    iterations : int
    converged : bool
    message : str
        The solver's own.
    """

    parameters: Vector = field(repr=False)
    iterations: int
    converged: bool
    message: str

    def sentence(self, step: str = "") -> str:
        """Return a sentence for the remarks on how the solver ended."""
        where = f"{step}: " if step else ""
        if self.converged:
            return f"{where}converged after {self.iterations} iterations."
        return f"{where}not converged after {self.iterations} iterations ({self.message.strip().rstrip('.')})."


def solve_program(
    program: NonlinearProgram,
    start: Vector,
    solver: SolverName,
    iterations: int,
    tolerance: float,
    progress: Progress | None = None,
    inside: Vector | None = None,
    repair: bool = True,
) -> Outcome:
    """Run a solver from parameters (n,).

    Parameters
    ----------
    program : NonlinearProgram
    start : (n,)
    solver : str
    iterations : int
        Limit.
    tolerance : float
    progress : callable, optional
    inside : (n,), optional
        Parameters strictly inside the conditions, towards which an answer outside is moved; the start where absent.
    repair : bool
        Whether an answer outside is moved.

    Raises
    ------
    MissingExtraError
        If IPOPT is not installed.
    """
    watch = _Watch(program, progress)
    x0 = program.to_unknowns(start)
    watch.remember(x0 if inside is None else program.to_unknowns(inside))
    watch.remember(x0)
    if solver == "slsqp":
        last, count, converged, message = _by_slsqp(program, x0, iterations, tolerance, watch)
    elif solver == "trust-constr":
        last, count, converged, message = _by_trust_constr(program, x0, iterations, tolerance, watch)
    else:
        last, count, converged, message = _by_ipopt(program, x0, iterations, tolerance, watch)
    if repair and watch.best is not None:
        last = _pulled_inside(program, last, watch.best)
        if program.objective(last) > watch.value:
            last = watch.best
    return Outcome(program.to_parameters(last), count, converged, message)


def _pulled_inside(program: NonlinearProgram, outside: Vector, inside: Vector) -> Vector:
    """The possible point nearest to `outside` on the line to `inside`; the set is convex."""
    if program.possible(outside):
        return outside
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if program.possible(outside + middle * (inside - outside)):
            high = middle
        else:
            low = middle
    return outside + high * (inside - outside)


class _Watch:
    """Remembers the best feasible iterate, and tells of the progress."""

    def __init__(self, program: NonlinearProgram, progress: Progress | None) -> None:
        self.program, self.progress = program, progress
        self.best: Vector | None = None
        self.value, self.count = np.inf, 0

    def remember(self, x: Vector) -> None:
        value = self.program.objective(x)
        if value < self.value and self.program.possible(x):
            self.best, self.value = np.array(x), value

    def __call__(self, x: Vector) -> None:
        self.count += 1
        self.remember(x)
        if self.progress is not None:
            error = self.program.problem.relative_error(self.program.to_parameters(x))
            self.progress(f"iteration {self.count}: relative error {error:.4%}")


_Result = tuple[Vector, int, bool, str]


def _by_slsqp(program: NonlinearProgram, x0: Vector, iterations: int, tolerance: float, watch: _Watch) -> _Result:
    import scipy.optimize

    minimize: Any = scipy.optimize.minimize
    _, _, E, e = program.linear
    # In these units all second derivatives by single unknowns are near 1, as the first step takes them to be.
    curvature = np.diagonal(program.quadratic[0])
    unit = 1.0 / np.sqrt(np.maximum(curvature, FLATTEST * curvature.max(initial=FLATTEST)))
    constraints: list[dict[str, Any]] = [
        {
            "type": "ineq",
            "fun": lambda z: program.constraints(unit * z),
            "jac": lambda z: program.jacobian(unit * z) * unit,
        }
    ]
    if len(E):
        constraints.append({"type": "eq", "fun": lambda z: E @ (unit * z) - e, "jac": lambda z: E * unit})
    point, inside, count = x0, watch.best, 0
    while True:
        found = minimize(
            lambda z: program.objective(unit * z),
            point / unit,
            jac=lambda z: program.gradient(unit * z) * unit,
            method="SLSQP",
            bounds=list(zip(program.lower / unit, np.full(len(x0), np.inf), strict=True)),
            constraints=constraints,
            callback=lambda z: watch(unit * z),
            options={"maxiter": iterations - count, "ftol": tolerance},
        )
        last = np.asarray(unit * found.x)
        count += max(int(found.nit), 1)
        if found.status not in BROKEN_DOWN or count >= iterations or inside is None or watch.best is None:
            break
        # Where its quadratic program has no answer, or its direction does not descend, it starts anew from inside.
        last = _pulled_inside(program, last, watch.best)
        if program.objective(last) >= program.objective(point) - RESTART * abs(program.objective(point)):
            break
        point = last + INWARD * (inside - last)
    return last, count, bool(found.success), str(found.message)


def _by_trust_constr(
    program: NonlinearProgram, x0: Vector, iterations: int, tolerance: float, watch: _Watch
) -> _Result:
    import scipy.optimize
    from scipy.optimize import Bounds, LinearConstraint

    minimize: Any = scipy.optimize.minimize
    nonlinear: Any = scipy.optimize.NonlinearConstraint

    A, _, E, e = program.linear
    count = program.conditions.count * len(program.problem.links) + len(A)
    constraints: list[Any] = [
        nonlinear(program.constraints, np.zeros(count), np.inf, program.sparse_jacobian, program.curvature)
    ]
    if len(E):
        constraints.append(LinearConstraint(sparse.csr_array(E), e, e))
    hessian = program.quadratic[0]

    def callback(x: Vector, _: Any) -> None:
        watch(x)

    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of steps that change no gradient
        found = minimize(
            program.objective,
            x0,
            jac=program.gradient,
            hess=lambda x: hessian,
            method="trust-constr",
            bounds=Bounds(program.lower, np.full(len(x0), np.inf)),
            constraints=constraints,
            callback=callback,
            options={"maxiter": iterations, "gtol": tolerance, "xtol": tolerance, "barrier_tol": tolerance},
        )
    return np.asarray(found.x), int(found.nit), found.status in (1, 2), str(found.message)


def _by_ipopt(program: NonlinearProgram, x0: Vector, iterations: int, tolerance: float, watch: _Watch) -> _Result:
    try:
        import cyipopt  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        raise MissingExtraError(
            'solver="ipopt" needs the package cyipopt; install it, or take "slsqp" or "trust-constr".'
        ) from None
    return _run_ipopt(cyipopt, program, x0, iterations, tolerance, watch)


def _run_ipopt(
    cyipopt: Any, program: NonlinearProgram, x0: Vector, iterations: int, tolerance: float, watch: _Watch
) -> _Result:
    A, _, E, e = program.linear
    n, links = len(x0), program.conditions.count * len(program.problem.links)
    lower_rows, lower_columns = np.tril_indices(n)
    hessian = program.quadratic[0]
    more_rows, more_columns = np.indices((len(A) + len(E), n)).reshape(2, -1)
    rows = np.concatenate([program.places[0], links + more_rows])
    columns = np.concatenate([program.places[1], more_columns])

    class Callbacks:
        iterations = 0
        objective = staticmethod(program.objective)
        gradient = staticmethod(program.gradient)

        def constraints(self, x: Vector) -> Vector:
            return np.concatenate([program.constraints(x), E @ x])

        def jacobian(self, x: Vector) -> Vector:
            values = program.conditions.jacobian(x[program.problem.links]).ravel()
            return np.concatenate([values, A.ravel(), E.ravel()])

        def jacobianstructure(self) -> Any:
            return rows, columns

        def hessian(self, x: Vector, multipliers: Vector, factor: float) -> Vector:
            whole = factor * hessian + program.curvature(x, multipliers)
            return np.asarray(whole[lower_rows, lower_columns])

        def hessianstructure(self) -> Any:
            return lower_rows, lower_columns

        def intermediate(self, *arguments: Any) -> bool:
            self.iterations = int(arguments[1])
            current = solver.get_current_iterate()
            if current is not None:
                watch(np.asarray(current["x"]))
            return True

    callbacks = Callbacks()
    solver = cyipopt.Problem(
        n=n,
        m=links + len(A) + len(E),
        problem_obj=callbacks,
        lb=program.lower,
        ub=np.full(n, np.inf),
        cl=np.concatenate([np.zeros(links + len(A)), e]),
        cu=np.concatenate([np.full(links + len(A), np.inf), e]),
    )
    options: dict[str, Any] = {"print_level": 0, "sb": "yes", "max_iter": iterations, "tol": tolerance}
    options |= {"bound_relax_factor": 0.0, "mu_strategy": "adaptive"}
    for name, value in options.items():
        solver.add_option(name, value)
    found, information = solver.solve(x0)
    message = information["status_msg"]
    text = message.decode() if isinstance(message, bytes) else str(message)
    return np.asarray(found), callbacks.iterations, information["status"] in (0, 1), text
