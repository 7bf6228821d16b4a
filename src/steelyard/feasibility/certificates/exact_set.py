"""Feasible sets in exact numbers, where every float stands for the decimal number that it prints."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.lmi import AffineBlock

from ..feasible_set import FeasibleSet
from .rational import exact_number, nearest_double
from .statement import EQUATION_TOLERANCE, Equation, MatrixCondition, Statement

__all__ = ["LAST_DIGITS", "exact_conditions", "exact_doubles", "exact_statement", "exact_vector", "speaks_of"]

LAST_DIGITS = Fraction(1, 10**12)
"""Largest difference between numbers of one robot on different processors, since base parameters of joints that mimic
others and facets of flat hulls are computed in floating point. 4e-15 was seen for the fingers of a Panda; lengths that
are measured again differ by more."""


def exact_vector(values: npt.NDArray[np.float64]) -> tuple[Fraction, ...]:
    """The decimal numbers that floats print."""
    return tuple(exact_number(value) for value in values.tolist())


def _elements(matrix: npt.NDArray[np.float64]) -> dict[tuple[int, int], Fraction]:
    rows, columns = np.nonzero(np.triu(matrix))
    return {(i, j): exact_number(matrix[i, j]) for i, j in zip(rows.tolist(), columns.tolist(), strict=True)}


def _condition(block: AffineBlock) -> MatrixCondition:
    indices = np.asarray(block.indices).tolist()
    return MatrixCondition(
        name=block.name,
        size=block.size,
        # Mass and inertia must be positive; friction may be zero, and constraints may hold with equality.
        strict=block.kind == "link",
        physical=block.kind != "constraint",
        constant=_elements(block.constant),
        coefficients={index: _elements(matrix) for index, matrix in zip(indices, block.coefficients, strict=True)},
    )


def exact_conditions(feasible_set: FeasibleSet) -> Statement:
    """The statement of a feasible set with zeros for the base parameters; it is made once for each set."""
    return feasible_set.kept(_exact_conditions)


def _exact_conditions(feasible_set: FeasibleSet) -> Statement:
    base = feasible_set.model.base_parameters()
    K = feasible_set.K
    rows = tuple({int(k): exact_number(row[k]) for k in np.flatnonzero(row)} for row in K)
    equations = []
    for equality in feasible_set.equalities:
        coefficients: dict[int, Fraction] = {}
        for index, value in zip(equality.indices, equality.coefficients, strict=True):
            coefficients[int(index)] = coefficients.get(int(index), Fraction(0)) + exact_number(float(value))
        equation = Equation(equality.name, coefficients, exact_number(equality.value), Fraction(0))
        equations.append(replace(equation, tolerance=EQUATION_TOLERANCE * equation.scale))
    names = tuple(str(name) for name in feasible_set.model.parameter_names)
    leading = tuple(names[i] for i in np.asarray(base.independent, dtype=np.intp))
    return Statement(
        robot=str(getattr(feasible_set.model.robot, "name", "robot")),
        consistency=feasible_set.consistency,
        parameter_names=names,
        base_expressions=tuple(getattr(base, "expressions", leading)),
        base=(Fraction(0),) * len(K),
        base_map=rows,
        conditions=tuple(_condition(block) for block in feasible_set.blocks),
        equations=tuple(equations),
    )


def speaks_of(
    document: Mapping[str, Any],
    feasible_set: FeasibleSet,
    base: npt.NDArray[np.float64] | None = None,
    *,
    rounding: Fraction = Fraction(0),
) -> str:
    """The part of a certificate's statement that differs from a feasible set (and base parameters); empty if none does.

    A certificate proves its own statement. Whether this is about a certain robot is checked by making the robot's
    statement again. A proof of feasibility may have more conditions than the robot, and a proof of infeasibility fewer:
    both imply the robot's own statement.

    Parameters
    ----------
    document : mapping
        A certificate as plain data.
    feasible_set : FeasibleSet
    base : (n_b,), optional
        Each must be the double nearest to the exact number of the certificate.
    rounding : Fraction
        Largest difference between numbers, relative to 1 and to their size. With 0 the certificate proves the robot's
        own statement; otherwise the comparison only shows that it was made for this robot, see `LAST_DIGITS`.
    """
    found = Statement.from_dict(document["statement"])
    expected = exact_conditions(feasible_set)
    for name in ("consistency", "parameter_names"):
        if getattr(found, name) != getattr(expected, name):
            return name.replace("_", " ")
    if len(found.base_map) != len(expected.base_map) or not all(
        _near(a, b, rounding) for a, b in zip(found.base_map, expected.base_map, strict=True)
    ):
        return "base map"
    more, less = (found, expected) if document["verdict"] == "feasible" else (expected, found)
    for name, alike in (("conditions", _same_condition), ("equations", _same_equation)):
        stated: dict[str, list[Any]] = {}
        for item in getattr(more, name):
            stated.setdefault(item.name, []).append(item)
        if not all(
            any(alike(item, other, rounding) for other in stated.get(item.name, ())) for item in getattr(less, name)
        ):
            return name
    if base is not None and exact_doubles(found.base) != base.tolist():
        return "base parameters"
    return ""


def exact_doubles(values: Sequence[Fraction]) -> list[float]:
    """The doubles nearest to exact numbers; infinite beyond the largest."""
    return [nearest_double(value) for value in values]


def _near(a: Mapping[Any, Fraction], b: Mapping[Any, Fraction], rounding: Fraction) -> bool:
    if not rounding:
        return a == b
    nothing, one = Fraction(0), Fraction(1)
    return all(
        abs(a.get(k, nothing) - b.get(k, nothing)) <= rounding * max(one, abs(a.get(k, nothing))) for k in {*a, *b}
    )


def _same_condition(a: MatrixCondition, b: MatrixCondition, rounding: Fraction) -> bool:
    return (
        (a.size, a.strict, a.physical) == (b.size, b.strict, b.physical)
        and _near(a.constant, b.constant, rounding)
        and all(
            _near(a.coefficients.get(k, {}), b.coefficients.get(k, {}), rounding)
            for k in {*a.coefficients, *b.coefficients}
        )
    )


def _same_equation(a: Equation, b: Equation, rounding: Fraction) -> bool:
    return _near(a.coefficients, b.coefficients, rounding) and _near(
        {"value": a.value, "tolerance": a.tolerance}, {"value": b.value, "tolerance": b.tolerance}, rounding
    )


def exact_statement(feasible_set: FeasibleSet, base: Sequence[Fraction]) -> Statement:
    """The question whether these base parameters are feasible."""
    return replace(exact_conditions(feasible_set), base=tuple(base))
