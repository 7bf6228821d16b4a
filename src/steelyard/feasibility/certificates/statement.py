"""Statements of certificates in exact numbers: base parameters, the map to them, conditions and equations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from steelyard.errors import InputError

from .rational import parse_number, written

__all__ = ["EQUATION_TOLERANCE", "FORMAT", "Equation", "Matrix", "MatrixCondition", "Statement"]

Matrix = list[list[Fraction]]
FORMAT = "steelyard-certificate-1"
"""Of the documents that certificates are written to."""
LARGEST_CONDITION = 1000
"""Largest order of a condition that is read, so that a damaged file cannot fill the memory."""

EQUATION_TOLERANCE = Fraction(1, 10**9)
"""Equations of constraints must hold to this part of their value or largest coefficient, since measured numbers are
rounded."""


def _dense(size: int, entries: Mapping[tuple[int, int], Fraction]) -> Matrix:
    matrix = [[Fraction(0)] * size for _ in range(size)]
    for (i, j), value in entries.items():
        matrix[i][j] = matrix[j][i] = value
    return matrix


@dataclass(frozen=True)
class MatrixCondition:
    """D(δ) = D₀ + Σ Dᵢ δᵢ positive definite (`strict`) or semidefinite; elements (i, j) with i ≤ j, others zero.

    Attributes
    ----------
    physical : bool
        Whether it belongs to a link or a term, rather than to a constraint.
    constant : mapping from (i, j) to value
    coefficients : mapping from parameter index to mapping from (i, j) to value
    """

    name: str
    size: int
    strict: bool
    physical: bool
    constant: Mapping[tuple[int, int], Fraction]
    coefficients: Mapping[int, Mapping[tuple[int, int], Fraction]]

    def evaluate(self, parameters: Sequence[Fraction]) -> Matrix:
        """D(δ)."""
        entries = dict(self.constant)
        for index, elements in self.coefficients.items():
            for place, value in elements.items():
                entries[place] = entries.get(place, Fraction(0)) + value * parameters[index]
        return _dense(self.size, entries)

    def products(self, dual: Matrix) -> tuple[Fraction, dict[int, Fraction]]:
        """<D₀, Z>, and <Dᵢ, Z> of each parameter."""

        def product(elements: Mapping[tuple[int, int], Fraction]) -> Fraction:
            places = ((value, dual[i][j], i == j) for (i, j), value in elements.items() if dual[i][j])
            return sum((value * z if diagonal else 2 * value * z for value, z, diagonal in places), Fraction(0))

        return product(self.constant), {index: product(elements) for index, elements in self.coefficients.items()}


@dataclass(frozen=True)
class Equation:
    """The equation Σ coefficient δᵢ = value, within a tolerance, since equations are given in floating point."""

    name: str
    coefficients: Mapping[int, Fraction]
    value: Fraction
    tolerance: Fraction

    @property
    def scale(self) -> Fraction:
        """The largest absolute value of the right side and the coefficients."""
        return max([abs(self.value), *(abs(c) for c in self.coefficients.values())])


@dataclass(frozen=True)
class Statement:
    """The question whether some δ satisfies K δ = β, all conditions and all equations.

    Attributes
    ----------
    base : tuple of Fraction
        β.
    base_map : tuple of mappings from parameter index to value
        Rows of K.
    """

    robot: str
    consistency: str
    parameter_names: tuple[str, ...]
    base_expressions: tuple[str, ...]
    base: tuple[Fraction, ...]
    base_map: tuple[Mapping[int, Fraction], ...]
    conditions: tuple[MatrixCondition, ...]
    equations: tuple[Equation, ...]

    def to_dict(self) -> dict[str, Any]:
        """The statement as plain data, with numbers as texts so that none is rounded."""

        def sparse(row: Mapping[int, Fraction]) -> list[list[Any]]:
            return [[index, written(value)] for index, value in row.items()]

        def elements(matrix: Mapping[tuple[int, int], Fraction]) -> list[list[Any]]:
            return [[i, j, written(value)] for (i, j), value in matrix.items()]

        return {
            "robot": self.robot,
            "consistency": self.consistency,
            "parameter_names": list(self.parameter_names),
            "base_expressions": list(self.base_expressions),
            "base": [written(value) for value in self.base],
            "base_map": [sparse(row) for row in self.base_map],
            "conditions": [
                {
                    "name": condition.name,
                    "size": condition.size,
                    "strict": condition.strict,
                    "physical": condition.physical,
                    "constant": elements(condition.constant),
                    "coefficients": [[index, elements(matrix)] for index, matrix in condition.coefficients.items()],
                }
                for condition in self.conditions
            ],
            "equations": [
                {
                    "name": equation.name,
                    "coefficients": sparse(equation.coefficients),
                    "value": written(equation.value),
                    "tolerance": written(equation.tolerance),
                }
                for equation in self.equations
            ],
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], where: str = "certificate") -> "Statement":
        """Build it from what `to_dict` returned.

        Raises
        ------
        InputError
            If something is missing, of a wrong kind or out of range; `where` is named in the message.
        """
        try:
            return cls._read(document)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(
                f"{where}: its statement is damaged ({_reason(error)[:300]}); save the certificate anew."
            ) from None

    @classmethod
    def _read(cls, document: Mapping[str, Any]) -> "Statement":
        names = tuple(_text(name) for name in _list(document["parameter_names"]))
        if len(set(names)) < len(names):
            raise ValueError("two parameters share a name")
        expressions = tuple(_text(name) for name in _list(document["base_expressions"]))
        count = len(names)

        def sparse(row: Any) -> dict[int, Fraction]:
            found: dict[int, Fraction] = {}
            for index, value in _list(row):
                if _index(index, count) in found:
                    raise ValueError(f"the parameter {names[index]} appears twice in a row")
                found[index] = parse_number(value)
            return found

        def elements(matrix: Any, size: int) -> dict[tuple[int, int], Fraction]:
            found: dict[tuple[int, int], Fraction] = {}
            for i, j, value in _list(matrix):
                if _index(i, size) > _index(j, size) or (i, j) in found:
                    raise ValueError(f"element ({i}, {j}) is below the diagonal or there twice")
                found[i, j] = parse_number(value)
            return found

        conditions = []
        for entry in _list(document["conditions"]):
            size = entry["size"]
            if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= LARGEST_CONDITION:
                raise ValueError(f"a condition has the size {size!r}")
            coefficients: dict[int, dict[tuple[int, int], Fraction]] = {}
            for index, matrix in _list(entry["coefficients"]):
                if _index(index, count) in coefficients:
                    raise ValueError(f"the parameter {names[index]} appears twice in a condition")
                coefficients[index] = elements(matrix, size)
            conditions.append(
                MatrixCondition(
                    _text(entry["name"]),
                    size,
                    _truth(entry["strict"]),
                    _truth(entry["physical"]),
                    elements(entry["constant"], size),
                    coefficients,
                )
            )
        equations = []
        for entry in _list(document["equations"]):
            tolerance = parse_number(entry["tolerance"])
            if tolerance < 0:
                raise ValueError("a tolerance is negative")
            equations.append(
                Equation(_text(entry["name"]), sparse(entry["coefficients"]), parse_number(entry["value"]), tolerance)
            )
        base = tuple(parse_number(value) for value in _list(document["base"]))
        rows = tuple(sparse(row) for row in _list(document["base_map"]))
        if not len(base) == len(rows) == len(expressions):
            raise ValueError(f"{len(base)} base parameters, {len(rows)} rows and {len(expressions)} expressions")
        return cls(
            _text(document["robot"]),
            _text(document["consistency"]),
            names,
            expressions,
            base,
            rows,
            tuple(conditions),
            tuple(equations),
        )


def _reason(error: Exception) -> str:
    return f"lacks {error}" if isinstance(error, KeyError) else str(error)


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"expected a list, got {type(value).__name__}")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"expected a text, got {type(value).__name__}")
    return value


def _truth(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"expected true or false, got {value!r}")
    return value


def _index(value: Any, count: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
        raise ValueError(f"index {value!r} is not below {count}")
    return value
