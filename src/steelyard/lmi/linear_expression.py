"""Affine expressions in named variables, the elements of linear matrix inequalities."""

from __future__ import annotations

import ast
import math
import numbers
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from steelyard.errors import InputError
from steelyard.files import suggestion, without_warnings

__all__ = ["LinearExpression", "as_expression", "distinct_names", "number_text", "parse_expression", "variables"]

_SIGNS = str.maketrans({"−": "-", "–": "-", "·": "*", "⋅": "*", "×": "*"})
_LONGEST_TEXT = 1_000_000
"""Longest text that is parsed, since parsing takes many times its memory."""

_TOO_DEEP = "is too long or nested too deeply; add several expressions, or give a mapping from names to coefficients."
_ALLOWED = "a sum of names and numbers, with + - * / and parentheses, such as 'Lyy1 + Iam1 - 2*m3'"


class LinearExpression:
    """A sum of named variables times numbers, and a constant: Σ cᵢ xᵢ + c₀.

    Immutable. Two expressions add and subtract; numbers add, multiply and divide. Multiplying two expressions is
    refused, since the result would not be affine.

    Parameters
    ----------
    terms : mapping from name to float
        cᵢ; zeros are dropped, the order is kept.
    constant : float
        c₀.

    Raises
    ------
    InputError
        If a coefficient is not a finite number, or a name is empty or not a string.

    See Also
    --------
    variables : The expressions that others are built from.
    parse_expression : From a text.

    Examples
    --------
    >>> m1, m2 = variables("m1 m2")
    >>> total = m1 + 0.5 * m2 - (m1 - 4) / 2
    >>> print(total)
    0.5*m1 + 0.5*m2 + 2
    >>> total.evaluate({"m1": 1.0, "m2": 3.0})
    4.0
    """

    __slots__ = ("_constant", "_terms")

    def __init__(self, terms: Mapping[str, float] | None = None, constant: float = 0.0) -> None:
        kept: dict[str, float] = {}
        for name, coefficient in (terms or {}).items():
            if not isinstance(name, str) or not name:
                raise InputError(f"a variable must have a name, got {name!r}; use a text such as 'm1'.")
            value = _finite(coefficient, f"the coefficient of {name}")
            if value != 0.0:
                kept[name] = value
        self._terms = kept
        self._constant = _finite(constant, "the constant of an expression")

    @property
    def terms(self) -> Mapping[str, float]:
        """Coefficients by name, in the order in which the variables appeared; none is zero."""
        return MappingProxyType(self._terms)

    @property
    def constant(self) -> float:
        """c₀."""
        return self._constant

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(self._terms)

    def coefficient(self, name: str) -> float:
        """Coefficient of a variable, 0 where it does not appear."""
        return self._terms.get(name, 0.0)

    def evaluate(self, values: Mapping[str, Any]) -> float:
        """The value at given values of the variables.

        Raises
        ------
        InputError
            If a variable has no value.

        Examples
        --------
        >>> LinearExpression({"x": 2.0}, 1.0).evaluate({"x": 3.0, "y": 0.0})
        7.0
        """
        total = self._constant
        for name, coefficient in self._terms.items():
            if name not in values:
                raise InputError(f"no value was given for {name!r}; {suggestion(name, values)}")
            total += coefficient * float(values[name])
        return total

    def substitute(self, values: Mapping[str, LinearExpression | float]) -> LinearExpression:
        """Return the same expression with other expressions, or numbers, for some of its variables, all at once.

        Examples
        --------
        >>> x, y = variables("x y")
        >>> print((x + 2 * y).substitute({"x": y, "y": x - 1}))
        y + 2*x - 2
        """
        found = LinearExpression(constant=self._constant)
        for name, coefficient in self._terms.items():
            found = found + coefficient * values.get(name, LinearExpression({name: 1.0}))
        return found

    def __neg__(self) -> LinearExpression:
        return self * -1.0

    def __pos__(self) -> LinearExpression:
        return self

    def __add__(self, other: object) -> LinearExpression:
        added = _as_operand(other)
        if added is None:
            return NotImplemented
        terms = dict(self._terms)
        for name, coefficient in added._terms.items():
            terms[name] = terms.get(name, 0.0) + coefficient
        return LinearExpression(terms, self._constant + added._constant)

    __radd__ = __add__

    def __sub__(self, other: object) -> LinearExpression:
        subtracted = _as_operand(other)
        return NotImplemented if subtracted is None else self + subtracted * -1.0

    def __rsub__(self, other: object) -> LinearExpression:
        return (self * -1.0).__add__(other)

    def __mul__(self, other: object) -> LinearExpression:
        factor = _as_operand(other)
        if factor is None:
            return NotImplemented
        if factor._terms and self._terms:
            raise InputError(f"({self}) * ({factor}) is not linear; multiply expressions by numbers only.")
        if factor._terms:
            return factor * self._constant
        number = factor._constant
        return LinearExpression({name: number * value for name, value in self._terms.items()}, number * self._constant)

    __rmul__ = __mul__

    def __truediv__(self, other: object) -> LinearExpression:
        divisor = _as_operand(other)
        if divisor is None:
            return NotImplemented
        if divisor._terms:
            raise InputError(f"({self}) / ({divisor}) is not linear; divide expressions by numbers only.")
        number = divisor._constant
        if number == 0.0:
            raise InputError(f"({self}) is divided by zero; divide by another number.")
        return LinearExpression({name: value / number for name, value in self._terms.items()}, self._constant / number)

    def __rtruediv__(self, other: object) -> LinearExpression:
        divided = _as_operand(other)
        return NotImplemented if divided is None else divided / self

    def __eq__(self, other: object) -> bool:
        compared = _as_operand(other)
        if compared is None:
            return NotImplemented
        return self._terms == compared._terms and self._constant == compared._constant

    def __hash__(self) -> int:
        return hash((frozenset(self._terms.items()), self._constant)) if self._terms else hash(self._constant)

    def __str__(self) -> str:
        return _written([(value, name) for name, value in self._terms.items()], self._constant)

    def __repr__(self) -> str:
        return f"LinearExpression({str(self)!r})"


def variables(names: str | Sequence[str]) -> tuple[LinearExpression, ...]:
    """One expression for each name.

    Parameters
    ----------
    names : str or sequence of str
        A text is split at spaces and commas.

    Returns
    -------
    tuple of LinearExpression
        Also where there is one name only.

    Raises
    ------
    InputError
        If there is no name, or one is given twice.

    Examples
    --------
    >>> x, y = variables("x y")
    >>> print(2 * x - y / 4 + 1)
    2*x - 0.25*y + 1
    """
    split = distinct_names(names)
    if not split:
        raise InputError("variables needs at least one name; write for example variables('m1 m2').")
    return tuple(LinearExpression({name: 1.0}) for name in split)


def distinct_names(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names of variables, a text split at spaces and commas.

    Raises
    ------
    InputError
        If one is not a text, is empty, or is given twice.
    """
    found = tuple(names.replace(",", " ").split()) if isinstance(names, str) else tuple(names)
    for name in found:
        if not isinstance(name, str) or not name:
            raise InputError(f"a variable must have a name, got {name!r}; use a text such as 'm1'.")
    if len(set(found)) < len(found):
        twice = next(name for name in found if found.count(name) > 1)
        raise InputError(f"the variable {twice!r} is named twice; give each name once.")
    return found


def number_text(value: float) -> str:
    """The shortest text that reads back as the same number, whole numbers without a point.

    Examples
    --------
    >>> number_text(2.0), number_text(-0.1), number_text(1e30)
    ('2', '-0.1', '1e+30')
    """
    if value == int(value) and abs(value) < 1e15:
        return str(int(value))
    return repr(float(value))


def _written(terms: list[tuple[float, str]], constant: float) -> str:
    parts: list[tuple[bool, str]] = []
    for value, name in terms:
        size = "" if abs(value) == 1.0 else f"{number_text(abs(value))}*"
        parts.append((value < 0, f"{size}{name}"))
    if constant != 0.0 or not parts:
        parts.append((constant < 0, number_text(abs(constant))))
    negative, text = parts[0]
    text = f"-{text}" if negative else text
    for negative, part in parts[1:]:
        text += f" {'-' if negative else '+'} {part}"
    return text


def _as_operand(value: object) -> LinearExpression | None:
    """An operand as an expression; None for what is neither an expression nor a real number."""
    if isinstance(value, LinearExpression):
        return value
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        return None
    return LinearExpression(constant=float(value))


def _finite(value: object, what: str) -> float:
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        raise InputError(f"{what} must be a number, got {value!r}.")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(f"{what} must be finite, got {value}.")
    return number + 0.0


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
        with without_warnings:
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
        known = dict.fromkeys(names)  # in their order, for the message
        for name in found.names:
            if name not in known:
                raise InputError(f"{where} {str(found)!r}: {_unknown(name, known)}")
    return found


def _unknown(name: str, known: Iterable[str]) -> str:
    return f"{name!r} is not among the names; {suggestion(name, known)}"


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
        # A long sum is a deep tree to the left, which a loop takes apart without recursion.
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
