"""Programs that solve semidefinite programs given as SDPA files: running them, and what they answer."""

import os
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

__all__ = ["Answer", "Program", "Words", "read_solution_file", "run_program", "stack"]

Vector = npt.NDArray[np.float64]

TIME_LIMIT = 600.0
"""Seconds after which a program is stopped."""

PROBLEM, SOLUTION = "problem.dat-s", "problem.solution"
"""Names of files in the temporary folder."""


@dataclass(frozen=True)
class Words:
    """What a program said: its exit code and its text.

    Attributes
    ----------
    code : int
    text : str
    folder : Path
        Where its files lie.
    """

    code: int
    text: str = field(repr=False)
    folder: Path = field(repr=False)


@dataclass(frozen=True, eq=False)
class Answer:
    """What a program found, with our signs.

    Attributes
    ----------
    outcome : Outcome
        As far as the program's own word goes.
    status : str
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
class Program:
    """A program that takes SDPA files.

    Attributes
    ----------
    title : str
    executable : str
    remedy : str
        How to install it.
    prepare : callable
        ``prepare(folder, accuracy, iterations, attempt)`` writes what files it wants and returns its arguments;
        attempts count from 0.
    interpret : callable
        ``interpret(words, program)`` returns the `Answer`; it may raise ValueError or OSError where it cannot.
    """

    title: str
    executable: str
    remedy: str
    prepare: Callable[[Path, float, int, int], Sequence[str]] = field(repr=False)
    interpret: Callable[[Words, SemidefiniteProgram], Answer] = field(repr=False)

    def installed(self) -> bool:
        """Whether it is found in the search path."""
        return shutil.which(self.executable) is not None

    def say(self, *arguments: str) -> str:
        """What it prints when called like that; empty where it cannot be run."""
        try:
            done = _call([self.executable, *arguments], None, 10.0)
        except (OSError, subprocess.TimeoutExpired):
            return ""
        return done.stdout + done.stderr


def _call(command: Sequence[str], folder: Path | None, limit: float) -> subprocess.CompletedProcess[str]:
    """In one thread, with numbers as in C."""
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
    program: Program, problem: SemidefiniteProgram, accuracy: float, iterations: int, attempt: int = 0
) -> Answer:
    """Solve a semidefinite program in a temporary folder.

    Parameters
    ----------
    program : Program
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
        words = Words(done.returncode, done.stdout + done.stderr, folder)
        if done.returncode < 0:
            raise SolverError(
                f'{program.title} crashed (signal {-done.returncode}); use another solver, such as solver="clarabel".'
            )
        try:
            answer = program.interpret(words, problem)
        except (ValueError, OSError, IndexError) as error:
            said = words.text.strip().splitlines()
            last = repr(said[-1][:80]) if said else "nothing"
            raise SolverError(
                f"the answer of {program.title} cannot be read (exit code {done.returncode}, its last words: {last}); "
                'use another solver, such as solver="clarabel".'
            ) from error
    return Answer(answer.outcome, answer.status, answer.x, answer.dual, answer.iterations, seconds)


def read_solution_file(words: Words, problem: SemidefiniteProgram) -> tuple[Vector, Vector]:
    """x and the stacked Y from a file as CSDP and DSDP write it.

    Its first line is x; then come entries (matrix, block, row, column, value), where matrix 1 is F(x) and matrix 2
    is Y.

    Raises
    ------
    ValueError, OSError
        If it is not of that form.
    """
    first, _, rest = (words.folder / SOLUTION).read_text(encoding="ascii").partition("\n")
    x = np.array(first.split(), dtype=float)
    entries = np.array(rest.split(), dtype=float).reshape(-1, 5)
    entries = entries[entries[:, 0] == 2]
    places = entries[:, 1:4].astype(np.intp) - 1
    if x.shape != problem.cost.shape:
        raise ValueError("the number of variables differs")
    return x, stack(problem, places[:, 0], places[:, 1], places[:, 2], entries[:, 4])


def stack(
    problem: SemidefiniteProgram,
    block: npt.NDArray[np.intp],
    row: npt.NDArray[np.intp],
    column: npt.NDArray[np.intp],
    value: Vector,
) -> Vector:
    """Elements of symmetric blocks, either triangle, as one vector; elements that are not given are zero."""
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
