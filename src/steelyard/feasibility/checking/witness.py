"""Parameters that prove feasibility, also where a solver ends close to the boundary or far out of scale."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..certificates import FeasibilityCertificate
from ..certificates.rational import exact_number
from ..facial_reduction import dual_face
from ..feasible_set import FeasibleSet
from .margin import largest_margin

__all__ = ["SCALED_ACCURACY", "proved_witness", "raised_witness", "scaled_witness"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

FLOORS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-9, 1e-10)
"""Smallest eigenvalues of a block, relative to its largest, that are kept when it is scaled; they are tried in turn,
since the first parameters are wrong in small eigenvalues."""

SCALED_ACCURACY = 1e-11
"""Accuracy of the solver on problems that are scaled around a point near the solution."""

LARGEST_ADDITION = 1e12
"""Largest unidentifiable mass, in kg, that is added to reach the inside; beyond, doubles have no digits left for
links."""

SHORT_DECIMAL, MAP_ACCURACY = 10**10, 1e-13
"""Elements of K with denominators up to the first number count as exact, others as accurate to the second."""


def proved_witness(feasible_set: FeasibleSet, base: Vector, parameters: Vector) -> FeasibilityCertificate | None:
    """The certificate of feasible parameters, or None if they are not proved feasible."""
    if not np.all(np.isfinite(parameters)):
        return None
    # Exact arithmetic is not needed for blocks that are far from positive definite.
    for block, smallest in zip(feasible_set.blocks, feasible_set.stack.smallest_eigenvalues(parameters), strict=True):
        if smallest < -1e-9 * max(1.0, float(np.abs(block.evaluate(parameters)).max(initial=0.0))):
            return None
    if not _beyond_rounding(feasible_set, parameters):
        return None
    certificate = FeasibilityCertificate(feasible_set, base, parameters)
    return certificate if certificate.verify() else None


def _beyond_rounding(feasible_set: FeasibleSet, parameters: Vector) -> bool:
    """Whether the blocks remain definite for all maps K that round to the given one.

    Elements of K that are not short decimals are rounded. With parameters of tonnes, rounding errors of terms that
    cancel could make an impossible robot of grams look possible.
    """
    change = feasible_set.kept(_rounding_of_map) @ np.abs(parameters)
    if not np.any(change):
        return True
    affected = np.zeros(feasible_set.parameter_count)
    affected[np.asarray(feasible_set.model.base_parameters().independent, dtype=np.intp)] = change
    for block in feasible_set.blocks:
        norms = np.abs(block.coefficients).sum(axis=2).max(axis=1)
        loss = float(affected[block.indices] @ norms)
        if loss > 0 and block.size > 1 and block.smallest_eigenvalue(parameters) <= loss:
            return False
    return True


def _rounding_of_map(feasible_set: FeasibleSet) -> Matrix:
    """Bound on the rounding errors of the elements of K."""
    found = np.zeros_like(feasible_set.K)
    for i, j in zip(*np.nonzero(feasible_set.K), strict=True):
        value = float(feasible_set.K[i, j])
        if exact_number(value).denominator > SHORT_DECIMAL:
            found[i, j] = MAP_ACCURACY * abs(value)
    return found


def raised_witness(feasible_set: FeasibleSet, base: Vector, parameters: Vector) -> FeasibilityCertificate | None:
    """Add unidentifiable mass until blocks that are definite on the face of the dual points are definite.

    With bases U of the face and V of its complement, D = [[D_UU, D_UV], [D_VU, D_VV + s G]] is positive definite for
    large s, because D_UU is.
    """
    face = dual_face(feasible_set)
    amount = 0.0
    for block, U in zip(feasible_set.blocks, face.bases, strict=True):
        size, rank = U.shape
        if rank == size:
            continue
        D = block.evaluate(parameters)
        added = np.tensordot(face.recession[block.indices], block.coefficients, axes=1)
        left = np.linalg.svd(U)[0] if rank else np.eye(size)
        Q, V = left[:, :rank], left[:, rank:]
        lacking = -(V.T @ D @ V)
        if rank:
            try:
                lacking += V.T @ D @ Q @ np.linalg.solve(Q.T @ D @ Q, Q.T @ D @ V)
            except np.linalg.LinAlgError:
                return None
        sizes, vectors = np.linalg.eigh(V.T @ added @ V)
        if sizes[0] <= 0 or not np.all(np.isfinite(lacking)):
            return None
        half = vectors / np.sqrt(sizes)
        amount = max(amount, float(np.linalg.eigvalsh(half.T @ lacking @ half)[-1]))
    for factor in (1.1, 3.0, 30.0, 1e3):
        if factor * amount > LARGEST_ADDITION:
            break
        found = proved_witness(feasible_set, base, parameters + factor * amount * face.recession)
        if found is not None:
            return found
    return None


def scaled_witness(feasible_set: FeasibleSet, base: Vector, parameters: Vector) -> FeasibilityCertificate | None:
    """Parameters inside the set, from the margin of blocks that are scaled around the best parameters so far."""
    whole = [np.eye(block.size) for block in feasible_set.blocks]
    for floor in FLOORS:
        scalings = _scalings(feasible_set, whole, parameters, floor)
        found = largest_margin(feasible_set, base, whole, scalings, 1e6 * len(whole), SCALED_ACCURACY)
        certificate = proved_witness(feasible_set, base, found.parameters)
        if certificate is not None:
            return certificate
        parameters = found.parameters
    return None


def _scalings(feasible_set: FeasibleSet, bases: Sequence[Matrix], parameters: Vector, floor: float) -> list[Matrix]:
    """C_b with C_bᵀ U_bᵀ |D_b(δ)| U_b C_b = 1, after eigenvalues are raised to `floor` times the largest."""
    found = []
    for block, U in zip(feasible_set.blocks, bases, strict=True):
        values, vectors = np.linalg.eigh(U.T @ block.evaluate(parameters) @ U)
        size = np.abs(values)
        largest = float(size.max(initial=0.0)) or 1.0
        found.append(vectors / np.sqrt(np.maximum(size, floor * largest)))
    return found
