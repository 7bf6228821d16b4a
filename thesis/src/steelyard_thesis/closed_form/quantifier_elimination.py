"""Quantifier elimination by an external program: QEPCAD (cylindrical algebraic decomposition)."""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
import signal
import subprocess
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from steelyard.codegen.sympy import import_sympy
from steelyard.errors import InputError, MissingExtraError

__all__ = ["eliminate", "qepcad_program"]

_CELLS = 40_000_000  # words of memory, 320 MB
_LONGEST = 10**6  # seconds, about eleven days
_RESULT = re.compile(r"An equivalent quantifier-free formula:(.*?)={5,}", re.DOTALL)
_TOKEN = re.compile(r"\s*(/\\|\\/|/=|<=|>=|[-+^<>=\[\]()~]|[0-9]+|[A-Za-z][A-Za-z0-9_]*)")


def qepcad_program() -> str:
    """Return the path of the program.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    found = shutil.which("qepcad")
    if found is None:
        raise MissingExtraError(
            "Quantifier elimination needs the program qepcad, which is not on the path; "
            "install it, on Debian with: apt install --no-install-recommends qepcad."
        )
    return found


def eliminate(variable: Any, conditions: Sequence[Any], timeout: float) -> Any:
    """Return what must hold for a real value of a variable to exist that satisfies all the conditions.

    Parameters
    ----------
    variable : sympy.Symbol
    conditions : sequence of sympy.Boolean
        Comparisons of polynomials with rational coefficients, and their conjunctions and disjunctions.
    timeout : float
        Seconds after which the program is stopped.

    Returns
    -------
    sympy.Boolean
        Without the variable.

    Raises
    ------
    InputError
        If the program cannot do it, or not in that time.
    MissingExtraError
        If the program is not installed.
    """
    sympy = import_sympy()
    free = sorted({s for c in conditions for s in c.free_symbols} - {variable}, key=lambda s: s.name)
    names = {symbol: f"v{k + 1}" for k, symbol in enumerate([*free, variable])}
    if not free:
        # The program wants a free variable; what holds does not depend on it.
        names = {sympy.Symbol("unused", real=True): "v0"} | names
    written = " /\\ ".join(_written(condition, names) for condition in conditions)
    lines = textwrap.fill(f"(E {names[variable]}) [ {written} ].", 200, break_on_hyphens=False, break_long_words=False)
    given = f"[]\n({','.join(names.values())})\n{len(names) - 1}\n{lines}\nfinish\n"
    answer = _run(given, timeout, f"eliminating {variable} from polynomials in {len(free)} other variables")
    found = _RESULT.search(answer)
    if found is None or "_root_" in found[1]:
        reason = re.search(r"Reason for the failure: *(.+)", answer)
        raise InputError(
            f"qepcad could not eliminate {variable} from polynomials in {len(free)} other variables"
            f"{': ' + reason[1].strip() if reason else ''}; use steelyard.check, which needs no closed form."
        )
    return _Reader(found[1], {name: symbol for symbol, name in names.items()}).read()


def _run(given: str, timeout: float, what: str) -> str:
    timeout = min(timeout, _LONGEST)
    # The limit on processor time also ends what outlives this process, should that be killed.
    limited = ["/bin/sh", "-c", 'ulimit -t "$0"; exec "$@"', str(math.ceil(timeout) + 1)]
    process = subprocess.Popen(
        [*limited, qepcad_program(), f"+N{_CELLS}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        answer, _ = process.communicate(given, timeout=timeout)
    except subprocess.TimeoutExpired:
        raise InputError(
            f"qepcad was stopped after {timeout:.3g} s of {what}: its work grows doubly exponentially with the "
            "variables; allow more time, or use steelyard.check, which needs no closed form."
        ) from None
    finally:
        if process.poll() is None:
            _stop(process.pid)
            process.communicate()
    return answer


def _stop(number: int) -> None:
    """Kill a process and all that it started: Singular, which QEPCAD calls, leaves the process group."""
    started = [number]
    for parent in started:
        with contextlib.suppress(OSError):  # where the system does not list children, their limit ends them
            started += map(int, Path(f"/proc/{parent}/task/{parent}/children").read_text().split())
    for each in started:
        with contextlib.suppress(ProcessLookupError):
            os.kill(each, signal.SIGKILL)


def _written(condition: Any, names: dict[Any, str]) -> str:
    """Write a condition in the program's language."""
    sympy = import_sympy()
    if isinstance(condition, (sympy.And, sympy.Or)):
        sign = " /\\ " if isinstance(condition, sympy.And) else " \\/ "
        return f"[ {sign.join(_written(argument, names) for argument in condition.args)} ]"
    if condition in (sympy.true, sympy.false):
        return "0 = 0" if condition == sympy.true else "0 = 1"
    polynomial = sympy.Poly(condition.lhs - condition.rhs, *names).clear_denoms(convert=True)[1]
    terms = []
    for powers, coefficient in polynomial.terms():
        factors = [f"{n}^{p}" if p > 1 else n for n, p in zip(names.values(), powers, strict=True) if p]
        number = abs(int(coefficient))
        text = " ".join(factors if factors and number == 1 else [str(number), *factors])
        terms.append(f"{'-' if coefficient < 0 else '+'} {text}")
    relation = {"!=": "/=", "==": "="}.get(condition.rel_op, condition.rel_op)
    return f"{' '.join(terms).removeprefix('+ ')} {relation} 0"


class _Reader:
    """Reads the program's formulas: ``[ v1 > 0 /\\ 2 v1 v2^2 - 1 < 0 ] \\/ v2 = 0``."""

    def __init__(self, text: str, symbols: dict[str, Any]) -> None:
        self.sympy = import_sympy()
        self.symbols = symbols
        self.tokens = _TOKEN.findall(text)
        self.place = 0
        if re.sub(r"\s", "", "".join(self.tokens)) != re.sub(r"\s", "", text):
            raise InputError(f"qepcad answered with what is no formula: {text.strip()[:200]!r}.")

    def read(self) -> Any:
        """Return the whole text as a SymPy Boolean."""
        formula = self._disjunction()
        if self._next() is not None:
            raise InputError(f"qepcad's answer goes on after its formula, with {self._next()!r}.")
        return formula

    def _next(self) -> str | None:
        return self.tokens[self.place] if self.place < len(self.tokens) else None

    def _take(self) -> str:
        token = self._next()
        if token is None:
            raise InputError("qepcad's answer ends within a formula.")
        self.place += 1
        return token

    def _disjunction(self) -> Any:
        parts = [self._conjunction()]
        while self._next() == "\\/":
            self._take()
            parts.append(self._conjunction())
        return self.sympy.Or(*parts)

    def _conjunction(self) -> Any:
        parts = [self._atom()]
        while self._next() == "/\\":
            self._take()
            parts.append(self._atom())
        return self.sympy.And(*parts)

    def _atom(self) -> Any:
        token = self._next()
        if token == "[":
            self._take()
            inside = self._disjunction()
            self._take()
            return inside
        if token == "~":
            self._take()
            return self.sympy.Not(self._atom())
        if token in ("TRUE", "FALSE"):
            return self.sympy.true if self._take() == "TRUE" else self.sympy.false
        left, relation = self._polynomial(), self._take()
        relations = {"/=": "!=", "=": "=="}
        return self.sympy.Rel(left, self._polynomial(), relations.get(relation, relation))

    def _polynomial(self) -> Any:
        total, sign = self.sympy.Integer(0), 1
        while True:
            token = self._next()
            if token in ("+", "-"):
                self._take()
                sign = -1 if token == "-" else 1
            elif (token is not None and token[0].isalnum()) or token == "(":
                total += sign * self._product()
            else:
                return total

    def _product(self) -> Any:
        product = self.sympy.Integer(1)
        while (token := self._next()) is not None and (token[0].isalnum() or token == "("):
            self._take()
            if token == "(":
                factor = self._polynomial()
                self._take()
            else:
                factor = self.sympy.Integer(token) if token.isdigit() else self.symbols[token]
            if self._next() == "^":
                self._take()
                factor **= int(self._take())
            product *= factor
        return product
