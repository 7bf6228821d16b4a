"""Certificates of feasibility and infeasibility, which can be checked without a solver.

They speak of the feasible set in exact numbers, where every float stands for the decimal number that it prints.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from steelyard.files import write_json
from steelyard.lmi import AffineBlock
from steelyard.once import cached_property

from ..feasible_set import FeasibleSet
from .rational import dot, exact_number, nearest_double, written
from .statement import EQUATION_TOLERANCE, FORMAT, Equation, MatrixCondition, Statement
from .statement import Matrix as ExactMatrix
from .verification import CertificateCheck, verify_dual_point, verify_witness

__all__ = [
    "LAST_DIGITS",
    "FeasibilityCertificate",
    "InfeasibilityCertificate",
    "exact_conditions",
    "exact_doubles",
    "exact_statement",
    "exact_vector",
    "save_certificate",
    "speaks_of",
]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

LAST_DIGITS = Fraction(1, 10**12)
"""Largest difference between numbers of one robot on different processors, since base parameters of joints that mimic
others and facets of flat hulls are computed in floating point. 4e-15 was seen for the fingers of a Panda; lengths that
are measured again differ by more."""


def exact_vector(values: npt.NDArray[np.float64]) -> tuple[Fraction, ...]:
    """The decimal numbers that floats print."""
    return tuple(exact_number(value) for value in values.tolist())


def _elements(matrix: npt.NDArray[np.float64]) -> dict[tuple[int, int], Fraction]:
    rows, columns = (places.tolist() for places in np.nonzero(matrix))
    return {(i, j): exact_number(matrix[i, j]) for i, j in zip(rows, columns, strict=True) if i <= j}


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


class CertificateDocument(Mapping[str, Any]):
    """A certificate as plain data that is put together when it is first read.

    Writing exact numbers takes longer than solving a small fit, and many certificates are never read.
    """

    def __init__(self, build: Callable[[], dict[str, Any]]) -> None:
        self._build = build

    @cached_property
    def _content(self) -> dict[str, Any]:
        return self._build()

    def __getitem__(self, key: str) -> Any:
        return self._content[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._content)

    def __len__(self) -> int:
        return len(self._content)


@dataclass(frozen=True, eq=False)
class FeasibilityCertificate:
    """Feasible standard parameters δ that have the base parameters β: K δ = β, D(δ) ≻ 0 (thesis 3.34).

    The proof is about the decimal numbers that floats print. Either β is given, and the independent parameters follow
    exactly from K δ = β and the other parameters; or δ is given, and β follows.

    Attributes
    ----------
    feasible_set : FeasibleSet
    base : (n_b,)
    parameters : (n,)
    given : {"base", "parameters"}
        Which of the two is given, so that it stands for the decimal numbers that its floats print.

    See Also
    --------
    FeasibilityCertificate.of_parameters : The certificate of standard parameters.
    """

    feasible_set: FeasibleSet = field(repr=False)
    base: Vector = field(repr=False)
    parameters: Vector = field(repr=False)
    given: Literal["base", "parameters"] = "base"

    @classmethod
    def of_parameters(cls, feasible_set: FeasibleSet, parameters: Vector) -> "FeasibilityCertificate":
        """The certificate that given parameters are feasible, as the decimal numbers that they print.

        Its `base` holds the doubles nearest to the exact K δ.
        """
        exact = _products(exact_conditions(feasible_set).base_map, exact_vector(parameters))
        return cls(feasible_set, np.array([float(value) for value in exact]), parameters, "parameters")

    @property
    def base_expressions(self) -> tuple[str, ...]:
        """The base parameters as combinations of standard parameters, as the statement names them."""
        return exact_conditions(self.feasible_set).base_expressions

    @cached_property
    def exact_base(self) -> tuple[Fraction, ...]:
        """β in rational numbers."""
        if self.given == "base":
            return exact_vector(self.base)
        return _products(exact_conditions(self.feasible_set).base_map, self.exact_parameters)

    @cached_property
    def exact_parameters(self) -> tuple[Fraction, ...]:
        """δ in rational numbers; K δ = β holds exactly."""
        if self.given == "parameters":
            return exact_vector(self.parameters)
        conditions = exact_conditions(self.feasible_set)
        found = list(exact_vector(self.parameters))
        independent = np.asarray(self.feasible_set.model.base_parameters().independent, dtype=np.intp).tolist()
        for index, row, value in zip(independent, conditions.base_map, exact_vector(self.base), strict=True):
            others = sum((c * found[k] for k, c in row.items() if k != index), Fraction(0))
            found[index] = (value - others) / row[index]
        return tuple(found)

    def verify(self) -> CertificateCheck:
        """Check the whole proof in rational arithmetic."""
        statement = exact_statement(self.feasible_set, self.exact_base)
        return verify_witness(statement, self.exact_parameters)

    def to_dict(self) -> dict[str, Any]:
        """The statement and its proof as plain data for JSON."""
        statement = exact_statement(self.feasible_set, self.exact_base)
        return {
            "format": FORMAT,
            "verdict": "feasible",
            "statement": statement.to_dict(),
            "proof": {"parameters": [written(value) for value in self.exact_parameters]},
        }

    def document(self) -> CertificateDocument:
        """The certificate as a document, which is put together when it is first read."""
        return CertificateDocument(self.to_dict)

    def save(self, path: str | Path) -> None:
        """Write it as JSON; the file appears whole or not at all."""
        save_certificate(self.to_dict(), path)


def _products(rows: Sequence[Mapping[int, Fraction]], parameters: Sequence[Fraction]) -> tuple[Fraction, ...]:
    return tuple(dot(row, parameters) for row in rows)


@dataclass(frozen=True, eq=False)
class InfeasibilityCertificate:
    """A dual point: matrices Z ⪰ 0 that contradict the feasibility of every δ with K δ = β.

    Z is orthogonal to all directions that the motion does not show, so that Σ <D_b(δ), Z_b> has the same value for
    every δ with K δ = β (up to the equations of constraints, which have multipliers). This value is negative, which is
    impossible if every D_b(δ) is positive semidefinite. In terms of base parameters: yᵀβ is negative, but yᵀK δ is not
    negative for any feasible δ.

    Attributes
    ----------
    feasible_set : FeasibleSet
    base : (n_b,)
    exact_direction : tuple of Fraction
        y.
    exact_dual : mapping from index of a block to rows of Fraction
        Z_b, for blocks in which it is not zero.
    exact_multipliers : tuple of Fraction
        Multipliers of the equations of constraints.
    shift : Fraction
        Z_b + shift 1 is positive semidefinite; 0 except for robots whose lengths are not decimal numbers.
    """

    feasible_set: FeasibleSet = field(repr=False)
    base: Vector = field(repr=False)
    exact_direction: tuple[Fraction, ...] = field(repr=False)
    exact_dual: Mapping[int, ExactMatrix] = field(repr=False)
    exact_multipliers: tuple[Fraction, ...] = field(repr=False)
    shift: Fraction = field(repr=False)

    @classmethod
    def exact(
        cls,
        feasible_set: FeasibleSet,
        base: Vector,
        direction: Sequence[Fraction],
        dual: Mapping[int, ExactMatrix],
        multipliers: Sequence[Fraction],
        shift: Fraction,
    ) -> "InfeasibilityCertificate":
        """The certificate of exact numbers, scaled such that the traces of the dual matrices add up to about 1."""
        total = sum((row[i] for matrix in dual.values() for i, row in enumerate(matrix)), Fraction(0))
        # A power of two keeps the numbers as short as they are.
        unit = (
            Fraction(2) ** (total.numerator.bit_length() - total.denominator.bit_length()) if total > 0 else Fraction(1)
        )

        def scaled(value: Fraction) -> Fraction:
            return value / unit if value else value

        return cls(
            feasible_set,
            base,
            tuple(scaled(value) for value in direction),
            {index: [[scaled(value) for value in row] for row in matrix] for index, matrix in dual.items()},
            tuple(scaled(value) for value in multipliers),
            scaled(shift),
        )

    @cached_property
    def direction(self) -> Vector:
        """y in floating point, (n_b,): the combination of base parameters that cannot be negative but is."""
        return np.array([float(value) for value in self.exact_direction])

    @cached_property
    def dual(self) -> dict[str, Matrix]:
        """Z_b of each block in floating point, by the block's name."""
        blocks = self.feasible_set.blocks
        return {
            blocks[index].name: np.array([[float(value) for value in row] for row in matrix])
            for index, matrix in self.exact_dual.items()
        }

    @property
    def blocks(self) -> tuple[tuple[str, float], ...]:
        """Names of the blocks that take part in the contradiction with their share (trace of Z_b), largest first."""
        shares = [(name, float(np.trace(dual))) for name, dual in self.dual.items()]
        total = sum(share for _, share in shares) or 1.0
        return tuple(sorted(((name, share / total) for name, share in shares), key=lambda item: -item[1]))

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the equations of constraints that take part in the contradiction."""
        pairs = zip(self.feasible_set.equalities, self.exact_multipliers, strict=True)
        return tuple(equality.name for equality, multiplier in pairs if abs(multiplier) > 1e-9)

    @cached_property
    def _checked(self) -> CertificateCheck:
        statement = exact_statement(self.feasible_set, exact_vector(self.base))
        return verify_dual_point(statement, self.exact_direction, self.exact_dual, self.exact_multipliers, self.shift)

    def verify(self) -> CertificateCheck:
        """Check the whole proof in rational arithmetic."""
        return self._checked

    def to_dict(self) -> dict[str, Any]:
        """The statement and its proof as plain data for JSON."""
        statement = exact_statement(self.feasible_set, exact_vector(self.base))
        return {
            "format": FORMAT,
            "verdict": "infeasible",
            "statement": statement.to_dict(),
            "proof": {
                "direction": [written(value) for value in self.exact_direction],
                "duals": [
                    [
                        index,
                        [[i, j, written(row[j])] for i, row in enumerate(matrix) for j in range(i, len(row)) if row[j]],
                    ]
                    for index, matrix in self.exact_dual.items()
                ],
                "multipliers": [written(value) for value in self.exact_multipliers],
                "shift": written(self.shift),
            },
        }

    def save(self, path: str | Path) -> None:
        """Write it as JSON; the file appears whole or not at all."""
        save_certificate(self.to_dict(), path)


def save_certificate(document: Mapping[str, Any], path: str | Path) -> None:
    """Write a certificate as JSON, whole or not at all."""
    write_json(dict(document), path)
