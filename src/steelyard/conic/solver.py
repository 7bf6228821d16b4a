"""The solvers by name, the table of what each can do, and `solve`, which hands a problem to one of them."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from steelyard.display import html_table, text_table
from steelyard.errors import InputError, MissingExtraError, SolverError, faults_told
from steelyard.extensions import Extensions
from steelyard.files import shown, suggestion

from .problem import CONE_KINDS, ConicProblem, ConicSolution

__all__ = ["FEATURES", "SOLVERS", "Solver", "SolverTable", "find_solver", "solve", "solver_table"]

FEATURES = ("quadratic", *CONE_KINDS)
"""What a problem may hold that a solver must know: a quadratic objective, and the kinds of cones."""


@dataclass(frozen=True)
class Solver:
    """A program or package that solves conic problems, and what it can do.

    Attributes
    ----------
    name : str
        As given to `solve`, in lower case.
    title : str
        Name in messages and tables.
    description : str
        The method, in a few words.
    run : callable
        ``run(problem, accuracy, iterations)`` returns a `ConicSolution`.
    native : frozenset of str
        Which of `FEATURES` it takes as they are.
    rewritten : frozenset of str
        Which it takes after they have been rewritten as semidefinite blocks.
    access : str
        ``"in memory"`` or ``"SDPA file"``.
    certificates : bool
        Whether an infeasible problem comes back with a direction that proves it.
    installed : callable
        ``installed()`` says whether it can be used on this machine.
    version : callable
        ``version()`` returns the version as text, empty where it cannot be had.
    remedy : str
        What to install where it is absent, e.g. ``"pip install scs"``.
    is_package : bool
        Whether it is a Python package, rather than a program.

    Examples
    --------
    A solver of one's own, registered under a name:

    >>> from steelyard.conic.clarabel_solver import solve_with_clarabel
    >>> careful = Solver(
    ...     name="careful",
    ...     title="Careful",
    ...     description="Clarabel with a tenth of the tolerance",
    ...     run=lambda problem, accuracy, iterations: solve_with_clarabel(problem, accuracy / 10, iterations),
    ...     native=frozenset(FEATURES),
    ... )
    >>> from steelyard.extensions import register, unregister
    >>> register("solvers", "careful", careful)
    >>> find_solver("careful").description
    'Clarabel with a tenth of the tolerance'
    >>> unregister("solvers", "careful")
    """

    name: str
    title: str
    description: str
    run: Callable[[ConicProblem, float, int], ConicSolution] = field(repr=False)
    native: frozenset[str]
    rewritten: frozenset[str] = frozenset()
    access: str = "in memory"
    certificates: bool = True
    installed: Callable[[], bool] = field(default=lambda: True, repr=False)
    version: Callable[[], str] = field(default=lambda: "", repr=False)
    remedy: str = ""
    is_package: bool = True

    def refuse(self, problem: ConicProblem) -> None:
        """Raise where the problem holds what this solver does not take.

        Raises
        ------
        InputError
            Names what it does not take, and solvers that do.
        """
        needed = {cone.kind for cone in problem.cones if cone.size}
        if problem.P.count_nonzero():
            needed.add("quadratic")
        for feature in FEATURES:
            if feature in needed and feature not in self.native | self.rewritten:
                others = [s.name for s in _known() if feature in s.native | s.rewritten]
                what = "a quadratic objective" if feature == "quadratic" else f"the {feature} cone"
                raise InputError(f"{self.title} does not take {what}; use {_either(others)}.")


def _either(names: list[str]) -> str:
    quoted = [f'solver="{name}"' for name in names]
    return " or ".join(quoted) if quoted else "another solver"


def _checked_solver(name: str, offered: object) -> Solver:
    if not isinstance(offered, Solver):
        raise TypeError(f"expected a steelyard.conic.Solver, got {shown(offered)}")
    unknown = sorted((offered.native | offered.rewritten).difference(FEATURES))
    if unknown:
        raise TypeError(f"{unknown[0]!r} is no feature of a problem; these are {', '.join(FEATURES)}")
    return offered if offered.name == name else replace(offered, name=name)


SOLVERS: Extensions[Solver] = Extensions(
    "solvers",
    "solver",
    {
        "clarabel": f"{__package__}.clarabel_solver:CLARABEL",
        "scs": f"{__package__}.scs_solver:SCS",
        "csdp": f"{__package__}.external_solver:CSDP_SOLVER",
        "dsdp": f"{__package__}.external_solver:DSDP_SOLVER",
        "sdpa": f"{__package__}.external_solver:SDPA_SOLVER",
    },
    _checked_solver,
)


def _known() -> Iterator[Solver]:
    """Yield all solvers, without those of packages that cannot be loaded."""
    for name in SOLVERS.names():
        with contextlib.suppress(InputError):
            yield find_solver(name)


def find_solver(name: str) -> Solver:
    """The solver of that name.

    Raises
    ------
    InputError
        If there is none, or its package cannot be loaded; names the closest one.
    """
    found = SOLVERS.get(name.lower()) if isinstance(name, str) else None
    if found is None:
        close = suggestion(str(name), SOLVERS.names())
        raise InputError(f"there is no solver {name!r} (solver_table() shows them); {close}")
    return found


def solve(
    problem: ConicProblem, accuracy: float = 1e-8, iterations: int = 200, solver: str = "clarabel"
) -> ConicSolution:
    """Solve a conic problem.

    Parameters
    ----------
    problem : ConicProblem
    accuracy : float
        Tolerance on the duality gap (absolute and relative) and on both feasibilities, in units in which the problem
        is well scaled.
    iterations : int
        Most iterations of an interior-point method to take; SCS takes up to a thousand of its own for each.
    solver : str
        One of the names in `solver_table`.

    Returns
    -------
    ConicSolution
        Also when nothing was found: look at its `outcome`, or call its `require`.

    Raises
    ------
    InputError
        For an unknown solver, or a problem that the solver does not take.
    MissingExtraError
        If the solver is a Python package that is not installed.
    SolverError
        If it is a program that is not installed, crashes or takes too long.

    Examples
    --------
    The smallest x with [[x, 1], [1, x]] positive semidefinite:

    >>> import numpy as np
    >>> import scipy.sparse as sparse
    >>> from steelyard.conic import Cone
    >>> A = sparse.csc_array(np.array([[-1.0], [0.0], [-1.0]]))
    >>> b = np.array([0.0, 2**0.5, 0.0])
    >>> problem = ConicProblem(sparse.csc_array((1, 1)), np.ones(1), A, b, (Cone("semidefinite", 2),))
    >>> solution = solve(problem)
    >>> solution.outcome, round(solution.objective, 6)
    (<Outcome.SOLVED: 'solved'>, 1.0)
    """
    chosen = find_solver(solver)
    chosen.refuse(problem)
    if not (0 < accuracy < 1) or iterations < 1:
        raise InputError(
            f"accuracy must lie between 0 and 1 and iterations be at least 1, got {accuracy!r} and {iterations!r}."
        )
    if not chosen.installed():
        error = MissingExtraError if chosen.is_package else SolverError
        raise error(f"{chosen.title} is not installed; install it with: {chosen.remedy}")
    if chosen.name in SOLVERS.own:
        return chosen.run(problem, accuracy, iterations)
    with faults_told(f"{chosen.title} failed", 'use another solver, such as solver="clarabel"', SolverError):
        return _checked_solution(chosen.run(problem, accuracy, iterations), problem)


def _checked_solution(found: object, problem: ConicProblem) -> ConicSolution:
    """Return what a solver of another package gives, if it is a solution of this problem by its shapes."""
    if not isinstance(found, ConicSolution):
        raise TypeError(f"expected a ConicSolution, got {shown(found)}")
    rows, unknowns = problem.A.shape
    for name, size in (("primal", unknowns), ("slack", rows), ("dual", rows)):
        values = np.asarray(getattr(found, name))
        if values.shape != (size,) or (found.usable and not np.isfinite(values).all()):
            raise ValueError(f"expected {size} finite numbers as {name}, got shape {values.shape}")
    return found


_HEADINGS = ("solver", "method", "access", *FEATURES, "proof", "here", "otherwise install with")


@dataclass(frozen=True)
class SolverTable:
    """A table of the registered solvers and of what they can do.

    A feature is taken as it is (``yes``), rewritten as semidefinite blocks first (``rewritten``), or not at all
    (``no``). ``proof`` says whether an infeasible problem comes back with a direction that proves it.

    Attributes
    ----------
    solvers : tuple of Solver
    """

    solvers: tuple[Solver, ...]

    @property
    def headings(self) -> tuple[str, ...]:
        """The headings of the columns."""
        return _HEADINGS

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """One tuple of texts for each solver."""
        return tuple(_row(solver) for solver in self.solvers)

    def __str__(self) -> str:
        rules = ["-" * max(map(len, column)) for column in zip(self.headings, *self.rows, strict=True)]
        return text_table(self.headings, [rules, *self.rows])

    def __repr__(self) -> str:
        return str(self)

    def _repr_html_(self) -> str:
        return html_table("", self.headings, self.rows)


def _row(solver: Solver) -> tuple[str, ...]:
    installed = solver.installed()
    version = solver.version() if installed else ""
    here = f"yes, {version}" if version else ("yes" if installed else "no")
    features = (
        "yes" if feature in solver.native else "rewritten" if feature in solver.rewritten else "no"
        for feature in FEATURES
    )
    remedy = "" if installed else solver.remedy
    proof = "yes" if solver.certificates else "no"
    return (solver.name, solver.description, solver.access, *features, proof, here, remedy)


def solver_table() -> SolverTable:
    """Return what every solver can do, whether it is on this machine, and how to install it otherwise.

    Returns
    -------
    SolverTable
        Prints as one table, also in a notebook.

    Examples
    --------
    >>> table = solver_table()
    >>> [row[0] for row in table.rows][:5]
    ['clarabel', 'scs', 'csdp', 'dsdp', 'sdpa']
    >>> table.headings[3:9]
    ('quadratic', 'zero', 'nonnegative', 'second-order', 'semidefinite', 'exponential')
    """
    return SolverTable(tuple(_known()))
