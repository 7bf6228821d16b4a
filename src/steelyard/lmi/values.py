"""Values of named variables: numbers, or expressions in other variables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError

from .expression import LinearExpression
from .expression_reader import as_expression

__all__ = ["linear_map", "values_as_vector"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


def values_as_vector(values: Mapping[str, Any] | npt.ArrayLike, names: Sequence[str]) -> Vector:
    """Numbers for the variables, in their order.

    Parameters
    ----------
    values : mapping from name to float, or (c,)
        A mapping may hold more names.
    names : sequence of c str

    Raises
    ------
    InputError
        If a value is missing or not a finite number, or a vector has another length.

    Examples
    --------
    >>> values_as_vector({"x": 1, "y": 2}, ["y", "x"]).tolist()
    [2.0, 1.0]
    """
    if isinstance(values, Mapping):
        for name in names:
            if name not in values:
                raise InputError(f"no value was given for the variable {name!r}; give one for each.")
        values = [values[name] for name in names]
    try:
        vector = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"the values of variables must be numbers, got {values!r}.") from None
    if vector.shape != (len(names),):
        raise InputError(f"there must be a value for each of {len(names)} variables, got the shape {vector.shape}.")
    bad = np.flatnonzero(~np.isfinite(vector))
    if len(bad):
        raise InputError(f"the value of {names[bad[0]]!r} must be finite, got {vector[bad[0]]}.")
    return vector


def linear_map(names: Sequence[str], values: Mapping[str, Any]) -> tuple[tuple[str, ...], Matrix, Vector]:
    """What substituting expressions for variables does: x = matrix y + offset.

    Parameters
    ----------
    names : sequence of c str
        The variables x.
    values : mapping from name to number, text, LinearExpression or SymPy expression
        Those not named stay.

    Returns
    -------
    tuple of k str
        The variables y, in the order in which they appear.
    (c, k)
        The matrix.
    (c,)
        The offset.

    Examples
    --------
    >>> linear_map(["a", "b"], {"a": "u - 2*b + 1"})[1].tolist()
    [[1.0, -2.0], [0.0, 1.0]]
    """
    given = {name: as_expression(value, where=f"the value of {name!r}:") for name, value in values.items()}
    rows = [given.get(name, LinearExpression({name: 1.0})) for name in names]
    found = tuple(dict.fromkeys(name for row in rows for name in row.names))
    place = {name: index for index, name in enumerate(found)}
    matrix = np.zeros((len(rows), len(found)))
    for line, row in zip(matrix, rows, strict=True):
        for name, value in row.terms.items():
            line[place[name]] = value
    return found, matrix, np.array([row.constant for row in rows])
