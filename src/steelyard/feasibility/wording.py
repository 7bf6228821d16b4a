"""Numbers and combinations of parameters as text, for messages and tables."""

import math
from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

import numpy as np
import numpy.typing as npt

from .feasible_set import FeasibleSet

__all__ = ["base_expressions", "base_names", "combination", "outward", "percent", "plain"]

Vector = npt.NDArray[np.float64]


def plain(value: float, digits: int = 4) -> str:
    """A number with a few digits; infinity as ∞.

    Examples
    --------
    >>> plain(0.000123456), plain(float("-inf"))
    ('0.0001235', '-∞')
    """
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    return f"{value + 0.0:.{digits}g}"


def percent(share: float, digits: int = 3) -> str:
    """A share in per cent with about `digits` digits.

    Examples
    --------
    >>> percent(0.9996), percent(0.01234, 2), percent(-0.00001234, 2)
    ('100 %', '1.2 %', '-0.0012 %')
    """
    value = 100.0 * share + 0.0
    if not math.isfinite(value):
        return f"{plain(value)} %"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if abs(value) >= 1e-4 else 0
    text = f"{value:.{decimals}f}"
    return f"{text.rstrip('0').rstrip('.') if '.' in text else text} %"


def outward(lower: float, upper: float) -> tuple[str, str]:
    """Both ends of an interval, rounded outward to about a thousandth of its width.

    Examples
    --------
    >>> outward(1.689123, 2.433012)
    ('1.6891', '2.4331')
    >>> outward(2.0 - 1e-9, float("inf"))
    ('2', '∞')
    """
    width = upper - lower
    finite = [abs(value) for value in (lower, upper) if math.isfinite(value)]
    size = max(finite, default=0.0)
    unit = width if math.isfinite(width) else size
    unit = max(unit, 1e-9 * size)
    if unit <= 0:
        return plain(lower), plain(upper)
    step = Decimal(1).scaleb(math.floor(math.log10(unit)) - 3)
    return _rounded(lower, step, ROUND_FLOOR), _rounded(upper, step, ROUND_CEILING)


def _rounded(value: float, step: Decimal, direction: str) -> str:
    if math.isinf(value):
        return plain(value)
    # Values may be off by a thousandth of the last digit, which must not change that digit.
    inward = Decimal("0.001") if direction == ROUND_FLOOR else Decimal("-0.001")
    number = (Decimal(value) / step + inward).to_integral_value(rounding=direction) * step
    text = f"{number:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    if len(text.lstrip("-0.")) > 0 and abs(value) < 1e-4:
        return f"{number.normalize():e}".replace("e-0", "e-")
    return text if text not in ("-0", "") else "0"


def base_expressions(feasible_set: FeasibleSet) -> tuple[str, ...]:
    """Each base parameter as a combination of standard ones, e.g. ``"Lzz1 + m2"``."""
    base = feasible_set.model.base_parameters()
    expressions = getattr(base, "expressions", None)
    if expressions is not None:
        return tuple(expressions)
    names = feasible_set.model.parameter_names
    return tuple(combination(row, names, digits=6) for row in feasible_set.K)


def base_names(feasible_set: FeasibleSet) -> tuple[str, ...]:
    """Short names: the leading parameter of each combination, with an R (regrouped) if there are others."""
    names = feasible_set.model.parameter_names
    leading = np.asarray(feasible_set.model.base_parameters().independent, dtype=np.intp)
    alone = np.count_nonzero(feasible_set.K, axis=1) == 1
    return tuple(f"{names[i]}{'' if single else 'R'}" for i, single in zip(leading, alone, strict=True))


def combination(weights: Vector, names: Sequence[str], most: int | None = None, digits: int = 3) -> str:
    """A weighted sum as text, with the terms in the given order; "..." stands for terms that are left out.

    Examples
    --------
    >>> combination(np.array([1.0, -0.25, 0.0]), ["Lzz1", "lx1 + m2", "ly1"])
    'Lzz1 - 0.25 (lx1 + m2)'
    """
    text = ""
    shown = 0
    for weight, name in zip(weights, names, strict=True):
        if weight == 0.0:
            continue
        if most is not None and shown == most:
            return text + " ..."
        size = plain(abs(float(weight)), digits)
        single = f"({name})" if " " in name and (size != "1" or weight < 0) else name
        term = single if size == "1" else f"{size} {single}"
        text += f"{'-' if weight < 0 else ''}{term}" if not text else f" {'-' if weight < 0 else '+'} {term}"
        shown += 1
    return text or "0"
