"""CSDP: a primal-dual interior-point method (Borchers 1999)."""

import re
from collections.abc import Sequence
from pathlib import Path

from .problem import Outcome
from .program import PROBLEM, SOLUTION, Answer, Program, Words, read_solution_file
from .semidefinite_program import SemidefiniteProgram

__all__ = ["CSDP", "csdp_version"]

_STATUS = {
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
"""By exit code. CSDP's primal is our dual, so that its primal infeasibility is our unboundedness."""


def _prepare(folder: Path, accuracy: float, iterations: int, attempt: int) -> Sequence[str]:
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


def _interpret(words: Words, problem: SemidefiniteProgram) -> Answer:
    if words.code not in _STATUS:
        raise ValueError("unknown exit code")
    outcome, status = _STATUS[words.code]
    x, dual = read_solution_file(words, problem)
    iterations = re.findall(r"^Iter: *(\d+)", words.text, re.MULTILINE)
    return Answer(outcome, status, x, dual, int(iterations[-1]) if iterations else 0)


def csdp_version() -> str:
    """As the program says it."""
    found = re.search(r"CSDP ([0-9.]+)", CSDP.say())
    return found[1] if found else ""


CSDP = Program("CSDP", "csdp", "apt install coinor-csdp", _prepare, _interpret)
