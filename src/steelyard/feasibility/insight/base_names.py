"""Names of base parameters, and combinations of them in words."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..feasible_set import FeasibleSet
from .table import plain

__all__ = ["base_expressions", "base_names", "combination"]

Vector = npt.NDArray[np.float64]


def base_expressions(feasible: FeasibleSet) -> tuple[str, ...]:
    """Each base parameter as a combination of standard ones, e.g. ``"Lzz1 + m2"``."""
    base = feasible.model.base_parameters()
    expressions = getattr(base, "expressions", None)
    if expressions is not None:
        return tuple(expressions)
    names = feasible.model.parameter_names
    return tuple(combination(row, names, digits=6) for row in feasible.K)


def base_names(feasible: FeasibleSet) -> tuple[str, ...]:
    """Short names: the parameter that leads the combination, with an R (regrouped) where it is not alone."""
    names = feasible.model.parameter_names
    leading = np.asarray(feasible.model.base_parameters().independent, dtype=np.intp)
    alone = np.count_nonzero(feasible.K, axis=1) == 1
    return tuple(f"{names[i]}{'' if single else 'R'}" for i, single in zip(leading, alone, strict=True))


def combination(weights: Vector, names: Sequence[str], most: int | None = None, digits: int = 3) -> str:
    """A weighted sum in words, terms in the order given; those left out are told by "...".

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
