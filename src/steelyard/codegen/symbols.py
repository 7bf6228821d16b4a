"""Symbols and numbers for SymPy: exact numbers, the substitutions of users, and the names of symbols in LaTeX."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from steelyard.errors import InputError, MissingExtraError
from steelyard.files import suggestion

__all__ = ["exact_number", "import_sympy", "intermediate_prefix", "latex_name", "substitution"]

# Dyadic fractions with larger denominators are measured numbers, whose exact form would only lengthen expressions.
_LARGEST_DENOMINATOR = 1024
_LARGEST_INTEGER = 2.0**53  # a larger float is not known to be a whole number
_FUNCTIONS = ("sin", "cos", "tan", "sqrt")
_ALLOWED = (
    ast.Expression,
    ast.BinOp,
    ast.UnaryOp,
    ast.Add,
    ast.Sub,
    ast.Mult,
    ast.Div,
    ast.Pow,
    ast.USub,
    ast.UAdd,
    ast.Name,
    ast.Load,
    ast.Constant,
    ast.Call,
)
_GREEK = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa", "lambda", "mu"),
    *("nu", "xi", "pi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega"),
)
_DOTS = {"d": r"\dot", "dd": r"\ddot"}


def import_sympy() -> Any:
    """Return the module sympy.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import sympy
    except ImportError as error:
        raise MissingExtraError(
            "Symbolic expressions need the package sympy, which is not installed; pip install 'steelyard[sympy]'."
        ) from error
    return sympy


def exact_number(value: float) -> Any:
    """Return a float as a SymPy number of the same value.

    Parameters
    ----------
    value : float
        Finite.

    Returns
    -------
    sympy.Number
        An integer or a dyadic rational where it is one with a denominator of at most 1024, otherwise a float of 53
        bits.

    Examples
    --------
    >>> exact_number(0.375), exact_number(-2.0), exact_number(9.81)
    (3/8, -2, 9.81000000000000)
    """
    sympy = import_sympy()
    if abs(value) < _LARGEST_INTEGER:
        fraction = Fraction(value)
        if fraction.denominator <= _LARGEST_DENOMINATOR:
            return sympy.Rational(fraction.numerator, fraction.denominator)
    return sympy.Float(value)


def substitution(
    given: Mapping[Any, Any], arguments: Mapping[str, tuple[Any, ...]]
) -> tuple[dict[Any, Any], dict[str, tuple[Any, ...]]]:
    """Read the substitutions of a user.

    Parameters
    ----------
    given : mapping
        From names (or symbols) to numbers, texts or SymPy expressions.
    arguments : mapping
        The symbols that can be substituted, by argument.

    Returns
    -------
    values : dict
        From symbols to expressions.
    arguments : dict
        The symbols that remain; those that the expressions bring are the argument ``"substituted"``.

    Raises
    ------
    InputError
        For an unknown name or a value that is no expression.
    """
    known = {symbol.name: symbol for row in arguments.values() for symbol in row}
    values: dict[Any, Any] = {}
    for key, value in given.items():
        name = str(key)
        if name not in known:
            raise InputError(f"There is no symbol {name!r} to substitute; {suggestion(name, known)}")
        values[known[name]] = _expression(name, value, known)
    own = set(known.values())
    brought = {symbol for value in values.values() for symbol in value.free_symbols}
    remaining = {
        name: tuple(symbol for symbol in row if symbol not in values or symbol in brought)
        for name, row in arguments.items()
    }
    added = sorted(brought - own, key=str)
    if added:
        remaining["substituted"] = (*remaining.get("substituted", ()), *added)
    return values, remaining


def _expression(name: str, value: Any, known: Mapping[str, Any]) -> Any:
    sympy = import_sympy()
    if isinstance(value, str):
        return _parsed(name, value, known)
    if isinstance(value, sympy.Expr):
        ours = {symbol: known[symbol.name] for symbol in value.free_symbols if symbol.name in known}
        return value.xreplace(ours)
    if isinstance(value, Fraction):
        return sympy.Rational(value.numerator, value.denominator)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not math.isfinite(number):
        raise InputError(f"{name} must be a finite number or an expression such as 'm2*c', got {value!r}.")
    return exact_number(number)


def _parsed(name: str, text: str, known: Mapping[str, Any]) -> Any:
    """Read an expression; only arithmetic is accepted, because SymPy's own parser runs any Python."""
    sympy = import_sympy()
    message = f"{name} cannot be {text!r}; an expression of numbers, names, + - * / ** and {', '.join(_FUNCTIONS)}"
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"{message} was expected.") from None
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    names: dict[str, Any] = {"pi": sympy.pi} | {function: getattr(sympy, function) for function in _FUNCTIONS}
    for node in ast.walk(tree):
        allowed = isinstance(node, _ALLOWED)
        if isinstance(node, ast.Name):
            if id(node) in called:
                allowed = node.id in _FUNCTIONS
            elif node.id in known:
                names[node.id] = known[node.id]
            elif node.id in _FUNCTIONS:
                allowed = False
            elif node.id not in names:
                names[node.id] = sympy.Symbol(node.id, real=True)
        if isinstance(node, ast.Constant):
            allowed = type(node.value) in (int, float)
        if not allowed:
            raise InputError(f"{message} was expected.")
    return _evaluated(tree.body, names, message)


def _evaluated(node: Any, names: Mapping[str, Any], message: str) -> Any:
    try:
        match node:
            case ast.Constant(value=value):
                return exact_number(value) if isinstance(value, float) else import_sympy().Integer(value)
            case ast.Name(id=name):
                return names[name]
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                return names[name](_evaluated(argument, names, message))
            case ast.UnaryOp(op=operator, operand=operand):
                inner = _evaluated(operand, names, message)
                return -inner if isinstance(operator, ast.USub) else inner
            case ast.BinOp(left=left, op=operator, right=right):
                a, b = _evaluated(left, names, message), _evaluated(right, names, message)
                match operator:
                    case ast.Add():
                        return a + b
                    case ast.Sub():
                        return a - b
                    case ast.Mult():
                        return a * b
                    case ast.Div() if not b.is_zero:
                        return a / b
                    case ast.Pow() if b.is_Integer and abs(b) <= 100:
                        return a**b
    except RecursionError:
        pass
    raise InputError(f"{message} was expected.")


def intermediate_prefix(taken: set[str]) -> str:
    """Return what the names of intermediate variables begin with: x, or another letter where other symbols do so."""
    letters = iter("xyzuvw")
    prefix = next(letters)
    while any(re.fullmatch(prefix + r"_?\d+", name) for name in taken):
        prefix = next(letters, prefix + "x")
    return prefix


def latex_name(name: str) -> str:
    r"""Return a symbol's name for LaTeX: a letter with its index.

    Examples
    --------
    >>> print(*map(latex_name, ("dq1", "Lxx12", "Fvj1", "m1", "beta1", "gx", "forearm")))
    \dot{q}_1 L_{xx,12} F_{vj,1} m_1 \beta_1 g_x \mathrm{forearm}
    """
    motion = re.fullmatch(r"(d{1,2})q(\d*)", name)
    if motion:
        return f"{_DOTS[motion[1]]}{{q}}{_subscript(motion[2])}"
    stem, number = re.fullmatch(r"(.*?)_?(\d*)", name).groups()  # type: ignore[union-attr]
    if stem in _GREEK:
        return f"\\{stem}{_subscript(number)}"
    if re.fullmatch(r"[A-Z][a-z]{1,3}|l[xyz]|[gp][xyz]", stem):
        index = f"{stem[1:]},{number}" if number else stem[1:]
        return f"{stem[0]}{_subscript(index)}"
    if len(stem) == 1 and stem.isalpha():
        return f"{stem}{_subscript(number)}"
    stem = stem.replace("_", r"\_")
    return f"\\mathrm{{{stem}}}{_subscript(number)}"


def _subscript(text: str) -> str:
    if not text:
        return ""
    return f"_{text}" if len(text) == 1 else f"_{{{text}}}"
