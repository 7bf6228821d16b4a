"""A feasible set in exact numbers: every float stands for the decimal number that it prints."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from ..feasible_set import FeasibleSet
from ..lmi import AffineBlock
from .rational import exact_number
from .statement import EQUATION_TOLERANCE, Equation, MatrixCondition, Statement

__all__ = ["exact_conditions", "exact_statement", "exact_vector", "speaks_of"]

_cache: WeakKeyDictionary[FeasibleSet, Statement] = WeakKeyDictionary()


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
        # Bodies have a positive mass and inertia; friction may be zero, and a constraint may be just met.
        strict=block.kind == "link",
        physical=block.kind != "constraint",
        constant=_elements(block.constant),
        coefficients={index: _elements(matrix) for index, matrix in zip(indices, block.coefficients, strict=True)},
    )


def exact_conditions(feasible: FeasibleSet) -> Statement:
    """The statement of a feasible set without a base parameter vector (zeros); made once for each set."""
    found = _cache.get(feasible)
    if found is None:
        base = feasible.model.base_parameters()
        K = feasible.K
        rows = tuple({int(k): exact_number(row[k]) for k in np.flatnonzero(row)} for row in K)
        equations = []
        for equality in feasible.equalities:
            coefficients: dict[int, Fraction] = {}
            for index, value in zip(equality.indices, equality.coefficients, strict=True):
                coefficients[int(index)] = coefficients.get(int(index), Fraction(0)) + exact_number(float(value))
            equation = Equation(equality.name, coefficients, exact_number(equality.value), Fraction(0))
            equations.append(replace(equation, tolerance=EQUATION_TOLERANCE * equation.scale))
        names = tuple(str(name) for name in feasible.model.parameter_names)
        leading = tuple(names[i] for i in np.asarray(base.independent, dtype=np.intp))
        found = Statement(
            robot=str(getattr(feasible.model.robot, "name", "robot")),
            consistency=feasible.consistency,
            parameter_names=names,
            base_expressions=tuple(getattr(base, "expressions", leading)),
            base=(Fraction(0),) * len(K),
            base_map=rows,
            conditions=tuple(_condition(block) for block in feasible.blocks),
            equations=tuple(equations),
        )
        _cache[feasible] = found
    return found


def speaks_of(document: Mapping[str, Any], feasible: FeasibleSet, base: npt.NDArray[np.float64] | None = None) -> str:
    """What of a certificate's statement differs from a feasible set (and base parameters); empty where nothing does.

    A certificate proves its own statement. That the statement is about a certain robot is seen by making it anew. A
    proof of feasibility may ask for more than the robot's own conditions, and a proof of infeasibility for less: either
    proves what the robot's own statement would.

    Parameters
    ----------
    document : mapping
        A certificate as plain data.
    feasible : FeasibleSet
    base : (n_b,), optional
        Each must be the double that is nearest to the certificate's exact number.
    """
    found = Statement.from_dict(document["statement"])
    expected = exact_conditions(feasible)
    for name in ("consistency", "parameter_names", "base_map"):
        if getattr(found, name) != getattr(expected, name):
            return name.replace("_", " ")
    more, less = (found, expected) if document["verdict"] == "feasible" else (expected, found)
    for name in ("conditions", "equations"):
        stated: dict[str, list[Any]] = {}
        for item in getattr(more, name):
            stated.setdefault(item.name, []).append(item)
        if any(item not in stated.get(item.name, ()) for item in getattr(less, name)):
            return name
    if base is not None and [float(value) for value in found.base] != base.tolist():
        return "base parameters"
    return ""


def exact_statement(feasible: FeasibleSet, base: Sequence[Fraction]) -> Statement:
    """The question whether these base parameters are feasible."""
    return replace(exact_conditions(feasible), base=tuple(base))
