"""Programs that solve semidefinite programs given as SDPA files: CSDP, DSDP and SDPA, and how each is run and read."""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from steelyard.errors import SolverError

from .problem import Outcome
from .semidefinite_program import SemidefiniteProgram

__all__ = ["CSDP", "DSDP", "SDPA", "Answer", "ExternalSolver", "ProgramOutput", "run_program"]

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
        According to the program itself; `file_solver` checks it.
    status : str
        In the words of the program.
    x : (m,)
        For `Outcome.UNBOUNDED` a direction.
    dual : (rows,)
        Y stacked as in `SemidefiniteProgram.to_conic`; for `Outcome.INFEASIBLE` a direction.
    iterations : int
    seconds : float
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
    title : str
    executable : str
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
        """Whether the executable is found in the search path."""
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
    program : ExternalSolver
    problem : SemidefiniteProgram
    accuracy : float
    iterations : int
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
    return Answer(answer.outcome, answer.status, answer.x, answer.dual, answer.iterations, seconds)


def _read_solution_file(output: ProgramOutput, problem: SemidefiniteProgram) -> tuple[Vector, Vector]:
    """Read x and the stacked Y from a solution file of CSDP or DSDP.

    Its first line is x; then come entries (matrix, block, row, column, value), where matrix 1 is F(x) and matrix 2
    is Y.

    Raises
    ------
    ValueError, OSError
        If it is not of that form.
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
