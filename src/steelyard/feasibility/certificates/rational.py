"""Exact arithmetic on rational numbers, without floating point."""

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from math import lcm

__all__ = [
    "SparseRows",
    "dot",
    "exact_number",
    "is_definite",
    "nearest_double",
    "parse_number",
    "written",
    "zero_combination_basis",
]

SparseRows = list[dict[int, Fraction]]
"""Rows of a sparse matrix: from column to value."""

_NUMBER = re.compile(r"[+-]?[0-9]{1,5000}(\.[0-9]{0,5000})?([eE][+-]?[0-9]{1,3})?|[+-]?[0-9]{1,5000}/[0-9]{1,5000}")


@lru_cache(maxsize=1024)
def exact_number(value: float) -> Fraction:
    """Return the decimal number that a finite float prints, such as 1/10 for 0.1.

    Examples
    --------
    >>> exact_number(0.1), exact_number(-3.0)
    (Fraction(1, 10), Fraction(-3, 1))
    """
    return Fraction(repr(float(value)))


def dot(row: Mapping[int, Fraction], values: Sequence[Fraction]) -> Fraction:
    """Return the product of a sparse row, from column to value, and a vector."""
    return sum((value * values[column] for column, value in row.items()), Fraction(0))


def nearest_double(value: Fraction) -> float:
    """Return the double that is nearest to a number, infinite beyond the largest.

    Examples
    --------
    >>> nearest_double(Fraction(1, 3)), nearest_double(Fraction(-(10**400)))
    (0.3333333333333333, -inf)
    """
    try:
        return float(value)
    except OverflowError:
        return float("-inf") if value < 0 else float("inf")


def written(value: Fraction) -> str:
    """Write a rational number as ``"12"``, a decimal where it ends, or ``"1/3"``.

    Examples
    --------
    >>> written(Fraction(-3, 8)), written(Fraction(1, 3)), written(Fraction(5)), written(Fraction(1, 1000))
    ('-0.375', '1/3', '5', '0.001')
    """
    numerator, denominator = value.numerator, value.denominator
    twos = fives = 0
    rest = denominator
    while rest % 2 == 0:
        rest, twos = rest // 2, twos + 1
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    if rest != 1:
        return f"{numerator}/{denominator}"
    places = max(twos, fives)
    digits = str(abs(numerator) * 10**places // denominator).rjust(places + 1, "0")
    text = digits if places == 0 else f"{digits[:-places]}.{digits[-places:]}"
    return f"-{text}" if numerator < 0 else text


def parse_number(text: object) -> Fraction:
    """Read what `written` wrote: an integer, a decimal, with an exponent or not, or a quotient of integers.

    Raises
    ------
    ValueError
        For anything else; exponents of more than three digits are refused, since they would fill the memory.

    Examples
    --------
    >>> parse_number("-0.375"), parse_number("1/3"), parse_number("2e-3")
    (Fraction(-3, 8), Fraction(1, 3), Fraction(1, 500))
    """
    if not isinstance(text, str) or _NUMBER.fullmatch(text) is None:
        raise ValueError(f"{text!r} is not a rational number such as 0.25 or 1/3")
    try:
        return Fraction(text)
    except ZeroDivisionError:
        raise ValueError(f"{text!r} divides by zero") from None


def is_definite(matrix: Sequence[Sequence[Fraction]], strict: bool) -> bool:
    """Whether a symmetric matrix is positive definite (`strict`) or semidefinite, by integer elimination (Bareiss).

    Examples
    --------
    >>> ones = [[Fraction(1)] * 2] * 2
    >>> is_definite(ones, strict=False), is_definite(ones, strict=True)
    (True, False)
    """
    size = len(matrix)
    scale = lcm(*(value.denominator for row in matrix for value in row)) if size else 1
    rows = [[int(value * scale) for value in row] for row in matrix]
    if any(rows[i][j] != rows[j][i] for i in range(size) for j in range(i)):
        return False
    previous = 1
    for k in range(size):
        pivot = rows[k][k]
        if pivot < 0 or (strict and pivot == 0):
            return False
        if pivot == 0:
            # In a semidefinite matrix the row of a zero diagonal element is zero; the rest remains to be checked.
            if any(rows[k][j] for j in range(k + 1, size)):
                return False
            continue
        for i in range(k + 1, size):
            for j in range(i, size):
                rows[i][j] = (pivot * rows[i][j] - rows[k][i] * rows[k][j]) // previous
                rows[j][i] = rows[i][j]
        previous = pivot
    return True


def _smallness(value: Fraction) -> int:
    """Minus the order of magnitude, in powers of eight."""
    return (value.denominator.bit_length() - value.numerator.bit_length()) // 3


def zero_combination_basis(rows: SparseRows, preference: Sequence[int]) -> dict[int, dict[int, Fraction]]:
    """Solve M u = 0 exactly: each pivot unknown by the coefficients of the free ones, all the others.

    Parameters
    ----------
    rows : sparse rows of M
    preference : sequence of int
        Rank of each unknown as a pivot, smallest first. Among equals those with a large coefficient are taken, so that
        errors of the free unknowns do not grow, and of these the one in the fewest rows.

    Examples
    --------
    >>> zero_combination_basis([{0: Fraction(2), 1: Fraction(-1)}], [0, 1])
    {0: {1: Fraction(1, 2)}}
    """
    work = [{column: value for column, value in row.items() if value} for row in rows]
    where: dict[int, set[int]] = {}
    for index, row in enumerate(work):
        for column in row:
            where.setdefault(column, set()).add(index)
    pivots: dict[int, int] = {}
    waiting = set(range(len(work)))
    while waiting:
        index = min(waiting, key=lambda i: (len(work[i]), i))
        waiting.discard(index)
        row = work[index]
        if not row:
            continue
        pivot = min(row, key=lambda column: (preference[column], _smallness(row[column]), len(where[column]), column))
        factor = row[pivot]
        for column in row:
            row[column] /= factor
        pivots[pivot] = index
        for other in list(where[pivot] - {index}):
            target = work[other]
            times = target[pivot]
            for column, value in row.items():
                changed = target.get(column, Fraction(0)) - times * value
                if changed:
                    target[column] = changed
                    where.setdefault(column, set()).add(other)
                elif column in target:
                    del target[column]
                    where[column].discard(other)
    return {
        pivot: {column: -value for column, value in work[index].items() if column != pivot}
        for pivot, index in pivots.items()
    }
