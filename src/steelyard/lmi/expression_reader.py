"""Expressions from texts, SymPy objects and numbers."""

from __future__ import annotations

import ast
import math
import numbers
import unicodedata
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

from steelyard.errors import InputError
from steelyard.robot.names import suggestion

from .expression import LinearExpression

__all__ = ["as_expression", "parse_expression"]

_SIGNS = str.maketrans({"−": "-", "–": "-", "·": "*", "⋅": "*", "×": "*"})
_LONGEST_TEXT = 1_000_000
_TOO_DEEP = "is too long or nested too deeply; add several expressions, or give a mapping from names to coefficients."
_ALLOWED = "a sum of names and numbers, with + - * / and parentheses, such as 'Lyy1 + Iam1 - 2*m3'"


def parse_expression(text: str, names: Iterable[str] | None = None, where: str = "expression") -> LinearExpression:
    """Read an affine expression such as ``"Lyy1 + Iam1 + 0.5*Lzz2 - 2*m3"``; nothing is executed.

    Parameters
    ----------
    text : str
        Names, numbers, ``pi``, + - * / and parentheses.
    names : iterable of str, optional
        The names that exist; any name is taken where absent.
    where : str
        What the message of an error begins with.

    Returns
    -------
    LinearExpression

    Raises
    ------
    InputError
        If the text is not an expression, is not affine, or holds an unknown name; the message says which part, and
        which name is closest.

    Examples
    --------
    >>> print(parse_expression("2*(m1 - 3) + Lzz2/4"))
    2*m1 + 0.25*Lzz2 - 6
    >>> parse_expression("m1 * m2")
    Traceback (most recent call last):
    ...
    steelyard.errors.InputError: expression 'm1 * m2' is not linear in 'm1 * m2'; multiply by numbers only.
    """
    if not isinstance(text, str):
        raise InputError(f"{where} must be a text, got {text!r}; write {_ALLOWED}.")
    shown = text if len(text) <= 200 else f"{text[:200]}..."
    if len(text) > _LONGEST_TEXT:
        raise InputError(f"{where} is a text of {len(text)} characters; at most {_LONGEST_TEXT} are read.")
    source = " ".join(text.translate(_SIGNS).split())
    if not source:
        raise InputError(f"{where} is empty; write {_ALLOWED}.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            node = ast.parse(source, mode="eval").body
    except (SyntaxError, ValueError):
        raise InputError(f"{where} {shown!r} cannot be read; write {_ALLOWED}.") from None
    except (RecursionError, MemoryError):
        raise InputError(f"{where} {shown!r} {_TOO_DEEP}") from None
    known = None if names is None else {unicodedata.normalize("NFKC", name): name for name in names}
    try:
        return _Reader(source, known, f"{where} {shown!r}").read(node)
    except RecursionError:
        raise InputError(f"{where} {shown!r} {_TOO_DEEP}") from None


def as_expression(value: Any, names: Iterable[str] | None = None, where: str = "expression") -> LinearExpression:
    """An expression from a number, a text, a mapping from names to coefficients, or a SymPy expression.

    Parameters
    ----------
    value : float, str, mapping, LinearExpression or SymPy expression
    names : iterable of str, optional
        The names that exist; any name is taken where absent.
    where : str
        What the message of an error begins with.

    Returns
    -------
    LinearExpression

    Raises
    ------
    InputError
        If it is none of these, is not affine, or holds an unknown name.

    Examples
    --------
    >>> print(as_expression({"Lyy1": 1.0, "m3": -2}), as_expression(3), sep=", ")
    Lyy1 - 2*m3, 3
    """
    if isinstance(value, str):
        return parse_expression(value, names, where)
    if isinstance(value, LinearExpression):
        found = value
    elif isinstance(value, Mapping):
        found = LinearExpression(value)
    elif hasattr(value, "free_symbols") and hasattr(value, "expand"):
        found = _from_sympy(value, where)
    elif isinstance(value, numbers.Real):
        found = LinearExpression(constant=value)  # type: ignore[arg-type]
    else:
        raise InputError(f"{where} must be a number, a text or an expression, got {value!r}; write {_ALLOWED}.")
    if names is not None:
        known = set(names)
        for name in found.names:
            if name not in known:
                raise InputError(f"{where} {str(found)!r}: {_unknown(name, known)}")
    return found


def _unknown(name: str, known: Iterable[str]) -> str:
    text = suggestion(name, known)
    return f"{name!r} is not among the names; {text}{'' if text.endswith('?') else '.'}"


class _Reader:
    """Walks over the nodes that a text may consist of."""

    def __init__(self, source: str, known: Mapping[str, str] | None, where: str) -> None:
        self.source = source
        self.known = known
        self.where = where

    def read(self, node: ast.expr) -> LinearExpression:
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                return self._number(value)
            case ast.Name(id=name):
                return self._variable(name)
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=operand):
                return self.read(operand) * (-1.0 if isinstance(sign, ast.USub) else 1.0)
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return self._sum(node)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                return self._product(self.read(left), self.read(right), node)
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                return self._quotient(self.read(left), self.read(right), node)
        raise InputError(f"{self.where} holds {self._text(node)}, which cannot be read; write {_ALLOWED}.")

    def _text(self, node: ast.expr) -> str:
        part = ast.get_source_segment(self.source, node) or "something"
        return repr(part if len(part) <= 80 else f"{part[:80]}...")

    def _number(self, value: float) -> LinearExpression:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise InputError(f"{self.where} holds a number that is too large; the largest is about 1e308.")
        return LinearExpression(constant=number)

    def _variable(self, name: str) -> LinearExpression:
        if self.known is not None and name in self.known:
            return LinearExpression({self.known[name]: 1.0})
        if name == "pi":
            return LinearExpression(constant=math.pi)
        if self.known is not None:
            raise InputError(f"{self.where}: {_unknown(name, self.known.values())}")
        return LinearExpression({name: 1.0})

    def _sum(self, node: ast.expr) -> LinearExpression:
        # A long sum leans to the left; a loop takes it apart without recursion.
        parts: list[tuple[float, LinearExpression]] = []
        while True:
            match node:
                case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as operator, right=right):
                    parts.append((-1.0 if isinstance(operator, ast.Sub) else 1.0, self.read(right)))
                    node = left
                case _:
                    parts.append((1.0, self.read(node)))
                    break
        terms: dict[str, float] = {}
        constant = 0.0
        for sign, part in reversed(parts):
            for name, value in part.terms.items():
                terms[name] = terms.get(name, 0.0) + sign * value
            constant += sign * part.constant
        return self._finite(terms, constant)

    def _finite(self, terms: dict[str, float], constant: float) -> LinearExpression:
        if not all(map(math.isfinite, (*terms.values(), constant))):
            raise InputError(f"{self.where} holds a number that is too large; the largest is about 1e308.")
        return LinearExpression(terms, constant)

    def _product(self, left: LinearExpression, right: LinearExpression, node: ast.expr) -> LinearExpression:
        if left.names and right.names:
            raise InputError(f"{self.where} is not linear in {self._text(node)}; multiply by numbers only.")
        factor, other = (left.constant, right) if not left.names else (right.constant, left)
        return self._finite({name: factor * v for name, v in other.terms.items()}, factor * other.constant)

    def _quotient(self, left: LinearExpression, right: LinearExpression, node: ast.expr) -> LinearExpression:
        if right.names:
            raise InputError(f"{self.where} is not linear in {self._text(node)}; divide by numbers only.")
        if right.constant == 0.0:
            raise InputError(f"{self.where} divides by zero in {self._text(node)}; divide by another number.")
        divisor = right.constant
        return self._finite({name: v / divisor for name, v in left.terms.items()}, left.constant / divisor)


def _from_sympy(value: Any, where: str) -> LinearExpression:
    expanded = value.expand()
    symbols = sorted(expanded.free_symbols, key=str)
    terms: dict[str, float] = {}
    try:
        for symbol in symbols:
            slope = expanded.diff(symbol).expand()
            if slope.free_symbols:
                raise InputError(f"{where} {str(value)!r} is not linear in {symbol}; multiply by numbers only.")
            terms[str(symbol)] = terms.get(str(symbol), 0.0) + float(slope)
        constant = float(expanded.subs(dict.fromkeys(symbols, 0)))
    except (TypeError, AttributeError):
        raise InputError(f"{where} {str(value)!r} is not an affine expression with real coefficients.") from None
    if not all(map(math.isfinite, (*terms.values(), constant))):
        raise InputError(f"{where} {str(value)!r} has a coefficient that is not finite.")
    return LinearExpression(terms, constant)
