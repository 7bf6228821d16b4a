"""SDPA: a primal-dual interior-point method (Yamashita et al. 2012)."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .problem import Outcome
from .program import PROBLEM, SOLUTION, Answer, Program, Words, stack
from .semidefinite_program import SemidefiniteProgram

__all__ = ["SDPA", "sdpa_version"]

_OUTCOMES = {
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
"""SDPA's primal is ours."""

PARAMETERS = "param.sdpa"

FINEST = 1e-7
"""Tolerances below this make it end early more often than they make its answers better."""

_NUMBER = re.compile(r"[-+]?[0-9][0-9.]*(?:e[-+]?[0-9]+)?|[-+]?(?:nan|inf)")


def _prepare(folder: Path, accuracy: float, iterations: int, attempt: int) -> Sequence[str]:
    accuracy = max(accuracy, FINEST)
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
    (folder / PARAMETERS).write_text("\n".join(lines) + "\n", encoding="ascii")
    return ["-ds", PROBLEM, "-o", SOLUTION, "-p", PARAMETERS]


def _interpret(words: Words, problem: SemidefiniteProgram) -> Answer:
    text = (words.folder / SOLUTION).read_text(encoding="ascii", errors="replace")
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
    dual = stack(problem, block[upper], row[upper], column[upper], values[upper])
    iterations = re.search(r"Iteration *= *(\d+)", text)
    outcome = _OUTCOMES.get(phase[1], Outcome.STOPPED)
    return Answer(outcome, phase[1], x, dual, int(iterations[1]) if iterations else 0)


def _numbers(text: str, name: str) -> npt.NDArray[np.float64]:
    """All numbers between a name and the end of what it is in braces."""
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


def sdpa_version() -> str:
    """As the program says it."""
    found = re.search(r"SDPA[^\n]*?([0-9]+\.[0-9]+\.[0-9]+)", SDPA.say("--version"))
    return found[1] if found else ""


SDPA = Program("SDPA", "sdpa", "apt install sdpa", _prepare, _interpret)
