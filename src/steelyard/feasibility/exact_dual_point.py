"""Exact dual points, from those of a solver, which satisfy their equations only approximately."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from steelyard.lmi import symmetric_to_vector

from .certificates import InfeasibilityCertificate
from .certificates.certificate import exact_conditions, exact_vector
from .certificates.rational import SparseRows, dot, exact_number, zero_combination_basis
from .certificates.statement import Matrix as ExactMatrix
from .certificates.verification import LEAST_RELATIVE_TRACE_BOUND, LEAST_TRACE_BOUND
from .facial_reduction import DualFace, dual_face, orthogonal
from .feasible_set import FeasibleSet
from .margin import DualPoint

__all__ = ["least_trace_bound", "prove_infeasible", "prove_infeasible_up_to_a_size"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _DualSpace:
    """All exact solutions of the equations of a dual point, as pivots that depend on free unknowns.

    The unknowns are the elements of W (upper triangles, block by block), the multipliers λ of the equations, and y.
    """

    places: tuple[tuple[int, int, int], ...]
    pivots: dict[int, dict[int, Fraction]]

    def complete(self, values: Sequence[Fraction]) -> list[Fraction]:
        """All unknowns, from the free ones among `values`."""
        found = list(values)
        for pivot, row in self.pivots.items():
            found[pivot] = dot(row, values)
        return found


def prove_infeasible(
    feasible_set: FeasibleSet, parameters: Vector, base: Vector, point: DualPoint, middle: DualPoint | None = None
) -> InfeasibilityCertificate | None:
    """The certificate that follows from a dual point, or None if it proves nothing.

    The point is moved towards the interior of the face, as far as it stays a contradiction, so that its matrices remain
    semidefinite after rounding. Then its free unknowns are taken as decimal numbers, and the others follow exactly. If
    the face has no exact decimal basis, the full matrices are repaired instead, and the proof holds up to a trace bound
    only.

    Parameters
    ----------
    parameters : (n,)
        Some δ with the base parameters β, such as P_b β; rounding errors are smaller for one near the center of the
        fibre.
    base : (n_b,)
        β.
    point : DualPoint
        Dual point of a solver, with a negative value.
    middle : DualPoint, optional
        Dual point in the interior of the face; by default that of `dual_face`.
    """
    face = dual_face(feasible_set)
    middle = DualPoint(face.interior, face.multipliers) if middle is None else middle
    value, middle_value = (_value(feasible_set, parameters, face, p) for p in (point, middle))
    if not value < 0:
        return None
    unit = -value / middle_value if middle_value > 0 else 1.0
    for candidate in (point, _projected(feasible_set, face, point)):
        for share in (0.3, 1e-3, 1e-6):
            certificate = _on_the_face(feasible_set, face, _moved(candidate, middle, share * unit), base)
            if certificate is not None and certificate.verify():
                return certificate
    best: tuple[float, InfeasibilityCertificate | None] = (0.0, None)
    for share in (0.3, 1e-4):
        moved = _projected(feasible_set, face, _moved(point, middle, share * unit))
        certificate = _beside_the_face(feasible_set, face, moved, base)
        verified = certificate.verify() if certificate is not None else None
        if verified and verified.trace_bound > best[0]:
            best = (verified.trace_bound, certificate)
    return best[1]


def prove_infeasible_up_to_a_size(
    feasible_set: FeasibleSet, point: DualPoint, base: Vector
) -> InfeasibilityCertificate | None:
    """The certificate that follows from a dual point of the whole blocks, if its trace bound is large enough.

    It serves if the face cannot be found in floating point, as for axes a thousandth of a degree from parallel.
    """
    whole = tuple(np.eye(block.size) for block in feasible_set.blocks)
    nothing = np.zeros(feasible_set.parameter_count)
    certificate = _beside_the_face(feasible_set, DualFace(whole, (), whole, point.multipliers, nothing), point, base)
    return certificate if certificate is not None and certificate.verify() else None


def least_trace_bound(base: Vector) -> float:
    """Least trace bound of a proof that counts, in kg and kg m²."""
    return max(LEAST_TRACE_BOUND, LEAST_RELATIVE_TRACE_BOUND * float(np.abs(base).max(initial=0.0)))


def _moved(point: DualPoint, middle: DualPoint, step: float) -> DualPoint:
    matrices = tuple(W + step * M for W, M in zip(point.matrices, middle.matrices, strict=True))
    return DualPoint(matrices, point.multipliers + step * middle.multipliers)


def _projected(feasible_set: FeasibleSet, face: DualFace, point: DualPoint) -> DualPoint:
    return DualPoint(*orthogonal(feasible_set, face.bases, point.matrices, point.multipliers))


def _value(feasible_set: FeasibleSet, particular: Vector, face: DualFace, point: DualPoint) -> float:
    """Σ <D_b(δ), Z_b> + λ·(E δ - f), the same for all δ with the same base parameters."""
    value = float(point.multipliers @ (feasible_set.equation_matrix @ particular - feasible_set.equation_values))
    for block, basis, W in zip(feasible_set.blocks, face.bases, point.matrices, strict=True):
        value += float(np.sum((basis.T @ block.evaluate(particular) @ basis) * W))
    return value


def _gradient(feasible_set: FeasibleSet, matrices: Sequence[Matrix], multipliers: Vector) -> Vector:
    gradient = feasible_set.equation_matrix.T @ multipliers
    for block, Z in zip(feasible_set.blocks, matrices, strict=True):
        np.add.at(gradient, block.indices, np.einsum("cij,ij->c", block.coefficients, Z))
    return np.asarray(gradient)


def _on_the_face(
    feasible_set: FeasibleSet, face: DualFace, point: DualPoint, base: Vector
) -> InfeasibilityCertificate | None:
    space = feasible_set.kept(_dual_space)
    matrices = [U @ W @ U.T for U, W in zip(face.bases, point.matrices, strict=True)]
    direction = _gradient(feasible_set, matrices, point.multipliers)[
        np.asarray(feasible_set.model.base_parameters().independent)
    ]
    floats = [float(point.matrices[b][i, j]) for b, i, j in space.places]
    scale = max((abs(value) for value in floats), default=0.0)
    if not np.isfinite(scale) or scale == 0.0:
        return None
    values = [exact_number(float(v)) for v in np.concatenate([floats, point.multipliers, direction]) / scale]
    found = space.complete(values)
    count, equations = len(space.places), len(feasible_set.equalities)
    duals: dict[int, ExactMatrix] = {}
    small: dict[int, dict[tuple[int, int], Fraction]] = {}
    for (b, i, j), value in zip(space.places, found[:count], strict=True):
        small.setdefault(b, {})[i, j] = small.setdefault(b, {})[j, i] = value
    for b, elements in small.items():
        if any(elements.values()):
            duals[b] = _expanded(face.exact_bases[b], elements)
    return InfeasibilityCertificate.exact(
        feasible_set, base, found[count + equations :], duals, found[count : count + equations], Fraction(0)
    )


def _expanded(basis: ExactMatrix, elements: dict[tuple[int, int], Fraction]) -> ExactMatrix:
    """U W Uᵀ."""
    size, rank = len(basis), len(basis[0])
    half = [
        [sum((row[i] * elements[i, j] for i in range(rank) if row[i]), Fraction(0)) for j in range(rank)]
        for row in basis
    ]
    return [
        [sum((half[p][j] * basis[q][j] for j in range(rank) if basis[q][j]), Fraction(0)) for q in range(size)]
        for p in range(size)
    ]


def _dual_space(feasible_set: FeasibleSet) -> _DualSpace:
    face = dual_face(feasible_set)
    conditions = exact_conditions(feasible_set)
    places: list[tuple[int, int, int]] = []
    rows: SparseRows = [{} for _ in conditions.parameter_names]
    for b, (condition, basis) in enumerate(zip(conditions.conditions, face.exact_bases, strict=True)):
        rank = len(basis[0])
        for i in range(rank):
            for j in range(i, rank):
                column = len(places)
                places.append((b, i, j))
                for parameter, elements in condition.coefficients.items():
                    value = Fraction(0)
                    for (p, q), element in elements.items():
                        if basis[p][i] and basis[q][j]:  # most elements of most bases are zero
                            value += element * basis[p][i] * basis[q][j]
                        if p != q and basis[q][i] and basis[p][j]:
                            value += element * basis[q][i] * basis[p][j]
                    if value:
                        rows[parameter][column] = value * (1 if i == j else 2)
    start = len(places)
    for e, equation in enumerate(conditions.equations):
        for parameter, coefficient in equation.coefficients.items():
            rows[parameter][start + e] = coefficient
    start += len(conditions.equations)
    for i, row in enumerate(conditions.base_map):
        for parameter, coefficient in row.items():
            rows[parameter][start + i] = -coefficient
    preference = [0] * len(places) + [2] * len(conditions.equations) + [1] * len(conditions.base_map)
    return _DualSpace(tuple(places), zero_combination_basis(rows, preference))


def _beside_the_face(
    feasible_set: FeasibleSet, face: DualFace, point: DualPoint, base: Vector
) -> InfeasibilityCertificate | None:
    """Keep y, let the blocks of links absorb the residual, and shift them to be positive semidefinite."""
    conditions = exact_conditions(feasible_set)
    matrices = [U @ W @ U.T for U, W in zip(face.bases, point.matrices, strict=True)]
    scale = max((float(np.abs(Z).max(initial=0.0)) for Z in matrices), default=0.0)
    if not np.isfinite(scale) or scale == 0.0:
        return None
    gradient = _gradient(feasible_set, [Z / scale for Z in matrices], point.multipliers / scale)
    direction, multipliers = _balanced(
        feasible_set,
        exact_vector(gradient[np.asarray(feasible_set.model.base_parameters().independent)]),
        exact_vector(point.multipliers / scale),
    )
    rest = [Fraction(0)] * len(conditions.parameter_names)
    for row, weight in zip(conditions.base_map, direction, strict=True):
        for parameter, coefficient in row.items():
            rest[parameter] += weight * coefficient
    for equation, multiplier in zip(conditions.equations, multipliers, strict=True):
        for parameter, coefficient in equation.coefficients.items():
            rest[parameter] -= multiplier * coefficient
    duals: dict[int, ExactMatrix] = {}
    for b, (condition, Z) in enumerate(zip(conditions.conditions, matrices, strict=True)):
        if not condition.physical:
            # The statement allows a shift for links and terms only.
            smallest = float(np.linalg.eigvalsh(Z)[0])
            Z = Z + (max(0.0, -2.0 * smallest) + 1e-15 * scale * (smallest < 1e-15 * scale)) * np.eye(len(Z))
        exact = [[exact_number(float(v)) for v in row] for row in ((Z + Z.T) / (2 * scale)).tolist()]
        duals[b] = exact
        for parameter, product in condition.products(exact)[1].items():
            rest[parameter] -= product
    shift = Fraction(0)
    for b, condition in enumerate(conditions.conditions):
        if not condition.physical:
            continue
        change = _absorb(feasible_set, b, [rest[k] for k in condition.coefficients])
        if change is None:
            return None
        dual = duals[b]
        for i in range(condition.size):
            for j in range(condition.size):
                dual[i][j] += change[i][j]
        for k in condition.coefficients:
            rest[k] = Fraction(0)
        smallest = float(np.linalg.eigvalsh(np.array([[float(v) for v in row] for row in dual]))[0])
        largest = max(float(abs(v)) for row in dual for v in row)
        shift = max(shift, exact_number(max(0.0, -2.0 * smallest) + 1e-15 * largest))
    if any(rest):
        return None
    return InfeasibilityCertificate.exact(feasible_set, base, direction, duals, multipliers, shift)


def _balanced(
    feasible_set: FeasibleSet, direction: tuple[Fraction, ...], multipliers: tuple[Fraction, ...]
) -> tuple[list[Fraction], list[Fraction]]:
    """y and λ, changed by rounding errors, that satisfy the equations of parameters without a condition exactly.

    An example is the offset of a motor. If such a parameter is part of several base parameters, no dual matrix can
    absorb the residual of its equation.
    """
    conditions = exact_conditions(feasible_set)
    held = {parameter for condition in conditions.conditions for parameter in condition.coefficients}
    rows: dict[int, dict[int, Fraction]] = {}
    for column, row in enumerate(conditions.base_map):
        for parameter, coefficient in row.items():
            if parameter not in held:
                rows.setdefault(parameter, {})[column] = coefficient
    for column, equation in enumerate(conditions.equations, start=len(direction)):
        for parameter, coefficient in equation.coefficients.items():
            if parameter not in held:
                rows.setdefault(parameter, {})[column] = -coefficient
    found = [*direction, *multipliers]
    preference = [0] * len(direction) + [1] * len(multipliers)
    for pivot, row in zero_combination_basis(list(rows.values()), preference).items():
        found[pivot] = dot(row, found)
    return found[: len(direction)], found[len(direction) :]


def _absorb(feasible_set: FeasibleSet, index: int, residual: list[Fraction]) -> ExactMatrix | None:
    """A symmetric matrix Z with <D_i, Z> = residual_i, from the dual basis of the coefficients; None if none exists."""
    block = feasible_set.blocks[index]
    size = block.size
    if not any(residual):
        return [[Fraction(0)] * size for _ in range(size)]
    vectors = symmetric_to_vector(block.coefficients)
    if np.linalg.matrix_rank(vectors) < len(vectors):
        return None
    # The Gram matrices of a link's coefficients have small rational inverses.
    inverse = np.linalg.inv(vectors @ vectors.T)
    exact_inverse = [[Fraction(v).limit_denominator(1000) for v in row] for row in inverse.tolist()]
    weights = [sum((a * r for a, r in zip(row, residual, strict=True)), Fraction(0)) for row in exact_inverse]
    change = [[Fraction(0)] * size for _ in range(size)]
    for weight, matrix in zip(weights, block.coefficients, strict=True):
        for i in range(size):
            for j in range(size):
                if matrix[i, j]:
                    change[i][j] += weight * exact_number(float(matrix[i, j]))
    return change
