"""Solving a conic problem with CSDP, DSDP or SDPA, programs that read SDPA files.

The problem is rewritten as a semidefinite program and scaled, the program is run, its answer read and checked.
"""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import SolverError

from .problem import (
    Cone,
    ConicProblem,
    ConicSolution,
    Outcome,
    dual_error,
    gap_error,
    infeasibility_error,
    least_distance,
    primal_error,
    recession_error,
)
from .rewriting import Decided, Rewritten, rewrite
from .scaling import Scaling, equilibrate, scaling_around
from .semidefinite_program import SemidefiniteProgram
from .solver import Solver

__all__ = [
    "CSDP",
    "CSDP_SOLVER",
    "DSDP",
    "DSDP_SOLVER",
    "SDPA",
    "SDPA_SOLVER",
    "Answer",
    "ExternalSolver",
    "ProgramOutput",
    "infeasibility_problem",
    "recession_problem",
    "run_program",
    "solve_with_program",
]

Vector = npt.NDArray[np.float64]

TIME_LIMIT = 600.0
"""Seconds after which a program is stopped."""

PROBLEM, SOLUTION = "problem.dat-s", "problem.solution"
"""Names of the files in the temporary folder."""


@dataclass(frozen=True)
class ProgramOutput:
    """The output of one run of a program.

    Attributes
    ----------
    code : int
        Exit code.
    text : str
        Standard output, then standard error.
    folder : Path
        The temporary folder in which it ran and wrote its files.
    """

    code: int
    text: str = field(repr=False)
    folder: Path = field(repr=False)


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of a program, with the signs of `SemidefiniteProgram`.

    Attributes
    ----------
    outcome : Outcome
        According to the program itself; `solve_with_program` checks it.
    status : str
        In the words of the program.
    x : (m,)
        For `Outcome.UNBOUNDED` a direction.
    dual : (rows,)
        Y stacked as in `SemidefiniteProgram.to_conic`; for `Outcome.INFEASIBLE` a direction.
    """

    outcome: Outcome
    status: str
    x: Vector = field(repr=False)
    dual: Vector = field(repr=False)
    iterations: int
    seconds: float = 0.0


@dataclass(frozen=True)
class ExternalSolver:
    """A program that reads SDPA files, and everything in which it differs from other such programs.

    Attributes
    ----------
    method : str
        The algorithm, in a few words.
    remedy : str
        How to install it.
    prepare : callable
        ``prepare(folder, accuracy, iterations, attempt)`` writes the files of parameters that the program needs into
        the folder, and returns its command-line arguments; attempts count from 0.
    interpret : callable
        ``interpret(output, problem)`` returns the `Answer`; it raises ValueError or OSError where the output cannot be
        read.
    version_arguments : tuple of str
        Command-line arguments with which the program prints its version.
    version_pattern : str
        Regular expression whose group 1 is the version in that output; empty where the program does not print one.
    """

    title: str
    executable: str
    method: str
    remedy: str
    prepare: Callable[[Path, float, int, int], Sequence[str]] = field(repr=False)
    interpret: Callable[[ProgramOutput, SemidefiniteProgram], Answer] = field(repr=False)
    version_arguments: tuple[str, ...] = ()
    version_pattern: str = ""

    def installed(self) -> bool:
        """Return whether the executable is found in the search path."""
        return shutil.which(self.executable) is not None

    def version(self) -> str:
        """The version that the program prints; empty where it prints none."""
        if not self.version_pattern:
            return ""
        try:
            done = _call([self.executable, *self.version_arguments], None, 10.0)
        except (OSError, subprocess.TimeoutExpired):
            return ""
        found = re.search(self.version_pattern, done.stdout + done.stderr)
        return found[1] if found else ""


def _call(command: Sequence[str], folder: Path | None, limit: float) -> subprocess.CompletedProcess[str]:
    """Run a command in one thread, with decimal points whatever the locale."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LC_ALL": "C"}
    return subprocess.run(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=limit,
        check=False,
    )


def run_program(
    program: ExternalSolver, problem: SemidefiniteProgram, accuracy: float, iterations: int, attempt: int = 0
) -> Answer:
    """Solve a semidefinite program in a temporary folder.

    Parameters
    ----------
    attempt : int
        How many attempts went before, so that other settings may be taken.

    Raises
    ------
    SolverError
        If the program is missing, crashes, takes too long, or its output cannot be read.
    """
    executable = shutil.which(program.executable)
    if executable is None:
        raise SolverError(
            f"{program.title} is not installed (no program {program.executable}); install it with: {program.remedy}"
        )
    with tempfile.TemporaryDirectory(prefix="steelyard-") as name:
        folder = Path(name)
        problem.write(folder / PROBLEM)
        arguments = program.prepare(folder, accuracy, iterations, attempt)
        start = time.perf_counter()
        try:
            done = _call([executable, *arguments], folder, TIME_LIMIT)
        except subprocess.TimeoutExpired as error:
            raise SolverError(
                f"{program.title} was stopped after {TIME_LIMIT:g} s without an answer; use another solver, such as "
                'solver="clarabel".'
            ) from error
        except OSError as error:
            raise SolverError(
                f"{executable} cannot be run ({error.strerror}); install {program.title} again."
            ) from error
        seconds = time.perf_counter() - start
        output = ProgramOutput(done.returncode, done.stdout + done.stderr, folder)
        if done.returncode < 0:
            raise SolverError(
                f'{program.title} crashed (signal {-done.returncode}); use another solver, such as solver="clarabel".'
            )
        try:
            answer = program.interpret(output, problem)
        except (ValueError, OSError, IndexError) as error:
            lines = output.text.strip().splitlines()
            last = repr(lines[-1][:80]) if lines else "nothing"
            raise SolverError(
                f"the answer of {program.title} cannot be read (exit code {done.returncode}, its last words: {last}); "
                'use another solver, such as solver="clarabel".'
            ) from error
    return replace(answer, seconds=seconds)


def _read_solution_file(output: ProgramOutput, problem: SemidefiniteProgram) -> tuple[Vector, Vector]:
    """Read x and the stacked Y from a solution file of CSDP or DSDP.

    Its first line is x; then come entries (matrix, block, row, column, value), where matrix 1 is F(x) and matrix 2
    is Y. A file of another form is a ValueError or an OSError.
    """
    first, _, rest = (output.folder / SOLUTION).read_text(encoding="ascii").partition("\n")
    x = np.array(first.split(), dtype=float)
    entries = np.array(rest.split(), dtype=float).reshape(-1, 5)
    entries = entries[entries[:, 0] == 2]
    places = entries[:, 1:4].astype(np.intp) - 1
    if x.shape != problem.cost.shape:
        raise ValueError("the number of variables differs")
    return x, _stack(problem, places[:, 0], places[:, 1], places[:, 2], entries[:, 4])


def _stack(
    problem: SemidefiniteProgram,
    block: npt.NDArray[np.intp],
    row: npt.NDArray[np.intp],
    column: npt.NDArray[np.intp],
    value: Vector,
) -> Vector:
    """Stack the elements of symmetric blocks, given in either triangle, as one vector; others are zero."""
    sizes = np.asarray(problem.block_sizes)
    rows = np.where(sizes < 0, -sizes, sizes * (sizes + 1) // 2)
    starts = np.concatenate([[0], np.cumsum(rows)])
    if len(block) and not (0 <= block.min() <= block.max() < len(sizes)):
        raise ValueError("a block does not exist")
    low, high = np.minimum(row, column), np.maximum(row, column)
    diagonal = sizes[block] < 0
    if np.any((low < 0) | (high >= np.abs(sizes[block])) | (diagonal & (low != high))):
        raise ValueError("an element lies outside its block")
    within = np.where(diagonal, high, high * (high + 1) // 2 + low)
    found = np.zeros(starts[-1])
    found[starts[block] + within] = value * np.where(low == high, 1.0, np.sqrt(2.0))
    return found


_CSDP_STATUS = {
    0: (Outcome.SOLVED, "SDP solved"),
    1: (Outcome.UNBOUNDED, "SDP is primal infeasible"),
    2: (Outcome.INFEASIBLE, "SDP is dual infeasible"),
    3: (Outcome.ALMOST_SOLVED, "partial success"),
    4: (Outcome.STOPPED, "maximum iterations reached"),
    5: (Outcome.STOPPED, "stuck at edge of primal feasibility"),
    6: (Outcome.STOPPED, "stuck at edge of dual feasibility"),
    7: (Outcome.STOPPED, "lack of progress"),
    8: (Outcome.STOPPED, "X, Z or O is singular"),
    9: (Outcome.STOPPED, "NaN or infinite values"),
}
"""By exit code. The primal problem of CSDP is the dual of `SemidefiniteProgram`, so that primal infeasibility there is
unboundedness here."""


def _prepare_csdp(folder: Path, accuracy: float, iterations: int, attempt: int) -> Sequence[str]:
    settings = {
        "axtol": accuracy,
        "atytol": accuracy,
        "objtol": accuracy,
        "pinftol": 1e8,
        "dinftol": 1e8,
        "maxiter": iterations,
        "minstepfrac": 0.9,
        "maxstepfrac": 0.97,
        "minstepp": 1e-8,
        "minstepd": 1e-8,
        "usexzgap": 1,
        "tweakgap": 0,
        "affine": 0,
        "printlevel": 1,
        "perturbobj": 0,
        "fastmode": 0,
    }
    text = "".join(f"{name}={value}\n" for name, value in settings.items())
    (folder / "param.csdp").write_text(text, encoding="ascii")
    return [PROBLEM, SOLUTION]


def _interpret_csdp(output: ProgramOutput, problem: SemidefiniteProgram) -> Answer:
    if output.code not in _CSDP_STATUS:
        raise ValueError("unknown exit code")
    outcome, status = _CSDP_STATUS[output.code]
    x, dual = _read_solution_file(output, problem)
    iterations = re.findall(r"^Iter: *(\d+)", output.text, re.MULTILINE)
    return Answer(outcome, status, x, dual, int(iterations[-1]) if iterations else 0)


CSDP = ExternalSolver(
    "CSDP",
    "csdp",
    "interior point",
    "apt install coinor-csdp",
    _prepare_csdp,
    _interpret_csdp,
    version_pattern=r"CSDP ([0-9.]+)",
)
"""A primal-dual interior-point method (Borchers 1999)."""


DSDP_STARTS: tuple[dict[str, float], ...] = ({"-r0": 100.0, "-penalty": 1e6}, {}, {"-r0": 10.0, "-boundy": 1e5})
"""Options of the attempts, in turn: how far inside the cone the method begins, and bounds on the trace and on the
variables. Problems arrive scaled to sizes near 1. For these DSDP's own choice (the second) begins so far inside that
digits are lost."""

DSDP_ITERATIONS_FOR_ONE = 5
"""Iterations of DSDP for one of a primal-dual method: they are cheaper, and more are needed."""


def _prepare_dsdp(folder: Path, accuracy: float, iterations: int, attempt: int) -> Sequence[str]:
    options = {"-save": SOLUTION, "-gaptol": accuracy, "-maxit": DSDP_ITERATIONS_FOR_ONE * iterations}
    options |= DSDP_STARTS[attempt % len(DSDP_STARTS)]
    return [PROBLEM, *(str(part) for option in options.items() for part in option)]


def _interpret_dsdp(output: ProgramOutput, problem: SemidefiniteProgram) -> Answer:
    x, dual = _read_solution_file(output, problem)
    if "Dual Infeasible" in output.text:
        outcome, status = Outcome.INFEASIBLE, "DSDP Primal Unbounded, Dual Infeasible"
    elif "Dual Unbounded" in output.text:
        outcome, status = Outcome.UNBOUNDED, "DSDP Dual Unbounded, Primal Infeasible"
    elif "DSDP Converged" in output.text:
        outcome, status = Outcome.SOLVED, "DSDP Converged"
    else:
        found = re.search(r"^DSDP (Terminated|Finished).*$|^.*Terminated.*$", output.text, re.MULTILINE)
        outcome, status = Outcome.STOPPED, found[0].strip() if found else "DSDP stopped"
    iterations = re.findall(r"^(\d+) +[-+0-9.e]+ +[-+0-9.e]+", output.text, re.MULTILINE)
    return Answer(outcome, status, x, dual, int(iterations[-1]) if iterations else 0)


DSDP = ExternalSolver(
    "DSDP", "dsdp5", "interior point, dual scaling", "apt install dsdp", _prepare_dsdp, _interpret_dsdp
)
"""A dual-scaling interior-point method (Benson and Ye 2008)."""


_SDPA_OUTCOMES = {
    "pdOPT": Outcome.SOLVED,
    "pFEAS": Outcome.STOPPED,
    "dFEAS": Outcome.STOPPED,
    "pdFEAS": Outcome.ALMOST_SOLVED,
    "noINFO": Outcome.STOPPED,
    "pdINF": Outcome.STOPPED,
    "pFEAS_dINF": Outcome.UNBOUNDED,
    "pINF_dFEAS": Outcome.INFEASIBLE,
    "pUNBD": Outcome.UNBOUNDED,
    "dUNBD": Outcome.INFEASIBLE,
}
"""By the phase that SDPA prints; its primal problem is that of `SemidefiniteProgram`."""

SDPA_PARAMETERS = "param.sdpa"

SDPA_FINEST = 1e-7
"""Smallest tolerance that is asked of SDPA: below, it ends early more often than its answers become better."""

_NUMBER = re.compile(r"[-+]?[0-9][0-9.]*(?:e[-+]?[0-9]+)?|[-+]?(?:nan|inf)")


def _prepare_sdpa(folder: Path, accuracy: float, iterations: int, attempt: int) -> Sequence[str]:
    accuracy = max(accuracy, SDPA_FINEST)
    lines = (
        f"{iterations} maxIteration",
        f"{accuracy} epsilonStar",
        "1.0E4 lambdaStar",
        "2.0 omegaStar",
        "-1.0E10 lowerBound",
        "1.0E10 upperBound",
        "0.1 betaStar",
        "0.3 betaBar",
        "0.9 gammaStar",
        f"{accuracy} epsilonDash",
        "%+24.17e xPrint",
        "NOPRINT XPrint",
        "%+24.17e YPrint",
        "%+24.17e infPrint",
    )
    (folder / SDPA_PARAMETERS).write_text("\n".join(lines) + "\n", encoding="ascii")
    return ["-ds", PROBLEM, "-o", SOLUTION, "-p", SDPA_PARAMETERS]


def _interpret_sdpa(output: ProgramOutput, problem: SemidefiniteProgram) -> Answer:
    text = (output.folder / SOLUTION).read_text(encoding="ascii", errors="replace")
    phase = re.search(r"phase\.value *= *(\w+)", text)
    if phase is None:
        raise ValueError("no phase")
    x = _numbers(text, "xVec")
    values = _numbers(text, "yMat")
    if x.shape != problem.cost.shape:
        raise ValueError("the number of variables differs")
    blocks, rows, columns = [], [], []
    for place, size in enumerate(problem.block_sizes):
        row, column = (np.arange(-size),) * 2 if size < 0 else np.indices((size, size)).reshape(2, -1)
        blocks.append(np.full(len(row), place))
        rows.append(row)
        columns.append(column)
    block, row, column = (np.concatenate(parts) for parts in (blocks, rows, columns))
    if len(values) != len(block):
        raise ValueError("the number of elements differs")
    upper = row <= column
    dual = _stack(problem, block[upper], row[upper], column[upper], values[upper])
    iterations = re.search(r"Iteration *= *(\d+)", text)
    outcome = _SDPA_OUTCOMES.get(phase[1], Outcome.STOPPED)
    return Answer(outcome, phase[1], x, dual, int(iterations[1]) if iterations else 0)


def _numbers(text: str, name: str) -> npt.NDArray[np.float64]:
    """All numbers in the braces that follow a name."""
    _, found, rest = text.partition(f"{name} =")
    if not found:
        raise ValueError(f"no {name}")
    depth, end = 0, len(rest)
    for brace in re.finditer(r"[{}]", rest):
        depth += 1 if brace[0] == "{" else -1
        if depth == 0:
            end = brace.end()
            break
    return np.array(_NUMBER.findall(rest[:end]), dtype=float)


SDPA = ExternalSolver(
    "SDPA",
    "sdpa",
    "interior point",
    "apt install sdpa",
    _prepare_sdpa,
    _interpret_sdpa,
    ("--version",),
    r"SDPA[^\n]*?([0-9]+\.[0-9]+\.[0-9]+)",
)
"""A primal-dual interior-point method (Yamashita et al. 2012)."""


SOLVED_ERROR, ALMOST_ERROR = 2e-5, 1e-3
"""Largest errors of a point that counts as solved, and as almost solved; see `_error`. They are
wider than the accuracy that the programs are asked for, which holds in the units of the rewritten problem."""

GRADIENT_SHARE = 0.02
"""Weight of the error of the gradient for quadratic objectives. They are rewritten as a Schur complement, in which a
program reaches its accuracy in the objective, but only about the square root of it in the gradient."""

PROOF_ERROR = 1e-6
"""Largest error of a direction that counts as a proof that no point exists, or that the objective is unbounded."""

ATTEMPTS: tuple[tuple[float, float | None], ...] = ((1.0, None), (10.0, 1e-4), (100.0, None))
"""The attempts, in this order until the program reports plain success: multiple of the accuracy that is asked for, and
the floor of `scaling_around` or None. With a coarser accuracy a program that stalls may still end with success."""


def solve_with_program(
    program: ExternalSolver, problem: ConicProblem, accuracy: float, iterations: int
) -> ConicSolution:
    """Solve a conic problem through an SDPA file.

    The outcome is decided by errors that are measured here, not by the status of the program alone. If the program
    returns neither a solution nor a proof that there is none, two auxiliary problems, which always have solutions, tell
    whether a point exists and whether the objective is bounded.

    Parameters
    ----------
    problem : ConicProblem
        Without exponential cones.
    accuracy : float
        Tolerance that the program is asked for.

    Raises
    ------
    SolverError
        See `run_program`.
    """
    balance = equilibrate(problem)
    balanced = balance.apply(problem.symmetric)
    found = _solve_balanced(program, balanced, accuracy, iterations)
    if found.outcome in (Outcome.ALMOST_SOLVED, Outcome.STOPPED):
        found = _explain(program, balanced, accuracy, iterations, found)
    return balance.undo(found)


def _solve_balanced(program: ExternalSolver, problem: ConicProblem, accuracy: float, iterations: int) -> ConicSolution:
    """Rewrite the problem as a semidefinite program, and run the external program until it succeeds."""
    rewritten = rewrite(problem)
    if isinstance(rewritten, Decided):
        return _decided(program, problem, rewritten)
    linear = rewritten.problem
    balance = _with_unit_cost(linear, equilibrate(linear))
    scaling, best, taken, seconds = balance, None, 0, 0.0
    least = np.inf
    for attempt, (multiple, floor) in enumerate(ATTEMPTS):
        if floor is not None and best is not None and np.isfinite(least):
            around = scaling_around(linear, linear.b - linear.A @ best[1], floor)
            scaling = _with_unit_cost(linear, around.then(equilibrate(around.apply(linear))))
        else:
            scaling = balance
        written = SemidefiniteProgram.from_conic(scaling.apply(linear))
        answer = run_program(program, written, min(multiple * accuracy, 1e-4), iterations, attempt)
        taken, seconds = taken + answer.iterations, seconds + answer.seconds
        primal, dual = scaling.columns * answer.x, scaling.rows * answer.dual / scaling.objective
        proof = _proof(program, problem, rewritten, answer, primal, dual)
        if proof is not None:
            return replace(proof, iterations=taken, seconds=seconds)
        x, slack, z = rewritten.recover(primal, dual)
        error = _error(problem, x, slack, z)
        if best is None or error < least:
            best, least = (_solution(program, problem, x, slack, z, error, answer), primal), error
        if error <= SOLVED_ERROR and (answer.outcome is Outcome.SOLVED or attempt > 0):
            break
    assert best is not None
    return replace(best[0], iterations=taken, seconds=seconds)


def _with_unit_cost(problem: ConicProblem, scaling: Scaling) -> Scaling:
    """The scaling, with an objective whose largest coefficient is 1."""
    largest = float(np.abs(scaling.columns * problem.q).max(initial=0.0))
    return replace(scaling, objective=1.0 / largest if largest > 0 else 1.0)


def _error(problem: ConicProblem, x: Vector, slack: Vector, z: Vector) -> float:
    """Largest of the relative errors: primal, distance from K, gradient (with its weight) and gap."""
    if not all(np.all(np.isfinite(vector)) for vector in (x, slack, z)):
        return float("inf")
    share = GRADIENT_SHARE if problem.P.count_nonzero() else 1.0
    outside = max(0.0, -least_distance(problem.cones, slack)) / (1.0 + float(np.abs(slack).max(initial=0.0)))
    return max(primal_error(problem, x, slack), outside, share * dual_error(problem, x, z), gap_error(problem, x, z))


def _solution(
    program: ExternalSolver, problem: ConicProblem, x: Vector, slack: Vector, z: Vector, error: float, answer: Answer
) -> ConicSolution:
    """A solution whose outcome follows from its error."""
    outcome = Outcome.ALMOST_SOLVED if error <= ALMOST_ERROR else Outcome.STOPPED
    outcome = Outcome.SOLVED if error <= SOLVED_ERROR else outcome
    objective = float(0.5 * x @ (problem.P @ x) + problem.q @ x)
    return ConicSolution(outcome, answer.status, x, slack, z, objective, 0, 0.0, program.title)


def _no_point(program: ExternalSolver, problem: ConicProblem, z: Vector, status: str) -> ConicSolution:
    nothing = np.full(problem.A.shape[1], np.nan)
    slack = np.full(len(problem.b), np.nan)
    return ConicSolution(Outcome.INFEASIBLE, status, nothing, slack, z, float("nan"), 0, 0.0, program.title)


def _no_bound(program: ExternalSolver, problem: ConicProblem, x: Vector, status: str) -> ConicSolution:
    nothing = np.full(len(problem.b), np.nan)
    slack = -(problem.A @ x)
    return ConicSolution(Outcome.UNBOUNDED, status, x, slack, nothing, -float("inf"), 0, 0.0, program.title)


def _decided(program: ExternalSolver, problem: ConicProblem, decided: Decided) -> ConicSolution:
    """The solution of a problem that the rewriting already decided."""
    status = "decided without the program"
    if decided.dual is not None:
        return _no_point(program, problem, decided.dual, status)
    assert decided.primal is not None
    if decided.unbounded:
        return _no_bound(program, problem, decided.primal, status)
    x, z = decided.primal, decided.multipliers
    answer = Answer(Outcome.SOLVED, status, x, z, 0)
    return _solution(program, problem, x, problem.b - problem.A @ x, z, 0.0, answer)


def _proof(
    program: ExternalSolver, problem: ConicProblem, rewritten: Rewritten, answer: Answer, primal: Vector, dual: Vector
) -> ConicSolution | None:
    """The proof of infeasibility or unboundedness that the program returned, if it holds; else None."""
    if answer.outcome is Outcome.INFEASIBLE:
        z = rewritten.certificate(dual)
        if infeasibility_error(problem, z) <= PROOF_ERROR:
            return _no_point(program, problem, z / -float(problem.b @ z), answer.status)
    if answer.outcome is Outcome.UNBOUNDED:
        x = rewritten.direction(primal)
        if recession_error(problem, x) <= PROOF_ERROR:
            return _no_bound(program, problem, x / -float(problem.q @ x), answer.status)
    return None


def _explain(
    program: ExternalSolver, problem: ConicProblem, accuracy: float, iterations: int, found: ConicSolution
) -> ConicSolution:
    """Look for a proof that no solution exists; return what was found before if there is none."""
    steps: tuple[tuple[Callable[[ConicProblem], ConicProblem], bool], ...] = (
        (infeasibility_problem, True),
        (recession_problem, False),
    )
    taken, seconds = found.iterations, found.seconds
    for build, about_points in steps:
        try:
            answer = _solve_balanced(program, build(problem), accuracy, iterations)
        except SolverError:  # this problem is only an additional question
            continue
        taken, seconds = taken + answer.iterations, seconds + answer.seconds
        if not answer.outcome.usable:
            continue
        if about_points:
            z = answer.dual[: len(problem.b)]
            if infeasibility_error(problem, z) <= PROOF_ERROR:
                found = _no_point(program, problem, z / -float(problem.b @ z), found.status)
                break
        elif recession_error(problem, answer.primal) <= PROOF_ERROR:
            x = answer.primal
            found = _no_bound(program, problem, x / -float(problem.q @ x), found.status)
    return replace(found, iterations=taken, seconds=seconds)


def _interior_element(cones: tuple[Cone, ...]) -> Vector:
    """A vector in the interior of the cones, zero for zero cones: ones, first unit vectors, unit matrices."""
    parts = [np.zeros(0)]
    for cone in cones:
        part = np.zeros(cone.rows)
        if cone.kind == "nonnegative":
            part[:] = 1.0
        elif cone.kind == "second-order":
            part[:1] = 1.0
        elif cone.kind == "semidefinite":
            part[np.cumsum(np.arange(1, cone.size + 1)) - 1] = 1.0
        parts.append(part)
    return np.concatenate(parts)


def infeasibility_problem(problem: ConicProblem) -> ConicProblem:
    """Minimise t subject to A x + s = b + t e, s in K, t ≥ -1, with e inside K.

    It always has points. Where its least value is positive, its dual point proves that the problem has none.
    """
    count = problem.A.shape[1]
    inside = _interior_element(problem.cones)
    last = sparse.csc_array(np.concatenate([-inside, [-1.0]])[:, None])
    above = sparse.vstack([problem.A, sparse.csc_array((1, count))])
    return ConicProblem(
        P=sparse.csc_array((count + 1, count + 1)),
        q=np.concatenate([np.zeros(count), [1.0]]),
        A=sparse.csc_array(sparse.hstack([above, last])),
        b=np.concatenate([problem.b, [1.0]]),
        cones=(*problem.cones, Cone("nonnegative", 1)),
    )


def recession_problem(problem: ConicProblem) -> ConicProblem:
    """Minimise qᵀd subject to -A d in K, P d = 0, qᵀd ≥ -1.

    Zero is a point of it. Where its least value is -1, the problem's objective falls without end along d.
    """
    rows, count = problem.A.shape
    curved = sparse.csc_array(problem.P)
    A = sparse.vstack([problem.A, curved, sparse.csc_array(-problem.q[None])])
    return ConicProblem(
        P=sparse.csc_array((count, count)),
        q=problem.q,
        A=sparse.csc_array(A),
        b=np.concatenate([np.zeros(rows + count), [1.0]]),
        cones=(*problem.cones, Cone("zero", count), Cone("nonnegative", 1)),
    )


def _solver(program: ExternalSolver) -> Solver:
    return Solver(
        name=program.title.lower(),
        title=program.title,
        description=program.method,
        run=partial(solve_with_program, program),
        native=frozenset({"nonnegative", "semidefinite"}),
        rewritten=frozenset({"quadratic", "zero", "second-order"}),
        access="SDPA file",
        installed=program.installed,
        version=program.version,
        remedy=program.remedy,
        is_package=False,
    )


CSDP_SOLVER, DSDP_SOLVER, SDPA_SOLVER = (_solver(program) for program in (CSDP, DSDP, SDPA))
"""The external programs as solvers."""
