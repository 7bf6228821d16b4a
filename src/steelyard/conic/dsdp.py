"""DSDP: a dual-scaling interior-point method (Benson and Ye 2008)."""

import re
from collections.abc import Sequence
from pathlib import Path

from .problem import Outcome
from .program import PROBLEM, SOLUTION, Answer, Program, Words, read_solution_file
from .semidefinite_program import SemidefiniteProgram

__all__ = ["DSDP"]

STARTS: tuple[dict[str, float], ...] = ({"-r0": 100.0, "-penalty": 1e6}, {}, {"-r0": 10.0, "-boundy": 1e5})
"""How far inside the method begins, and bounds on traces and variables that it needs: one after the other. Problems
come with all sizes near 1, for which DSDP's own choice (the second) begins so far inside that digits are lost."""

ITERATIONS_FOR_ONE = 5
"""Its iterations are cheaper and more than those of a primal-dual method."""


def _prepare(folder: Path, accuracy: float, iterations: int, attempt: int) -> Sequence[str]:
    options = {"-save": SOLUTION, "-gaptol": accuracy, "-maxit": ITERATIONS_FOR_ONE * iterations}
    options |= STARTS[attempt % len(STARTS)]
    return [PROBLEM, *(str(part) for option in options.items() for part in option)]


def _interpret(words: Words, problem: SemidefiniteProgram) -> Answer:
    x, dual = read_solution_file(words, problem)
    if "Dual Infeasible" in words.text:
        outcome, status = Outcome.INFEASIBLE, "DSDP Primal Unbounded, Dual Infeasible"
    elif "Dual Unbounded" in words.text:
        outcome, status = Outcome.UNBOUNDED, "DSDP Dual Unbounded, Primal Infeasible"
    elif "DSDP Converged" in words.text:
        outcome, status = Outcome.SOLVED, "DSDP Converged"
    else:
        said = re.search(r"^DSDP (Terminated|Finished).*$|^.*Terminated.*$", words.text, re.MULTILINE)
        outcome, status = Outcome.STOPPED, said[0].strip() if said else "DSDP stopped"
    iterations = re.findall(r"^(\d+) +[-+0-9.e]+ +[-+0-9.e]+", words.text, re.MULTILINE)
    return Answer(outcome, status, x, dual, int(iterations[-1]) if iterations else 0)


DSDP = Program("DSDP", "dsdp5", "apt install dsdp", _prepare, _interpret)
