"""Proofs of feasibility and infeasibility that are checked without the solver."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..feasible_set import FeasibleSet

__all__ = ["CertificateCheck", "FeasibilityCertificate", "InfeasibilityCertificate"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

LEAST_REACH = 1e6
"""An infeasibility certificate must exclude all parameters up to this size (SI units) to count."""


@dataclass(frozen=True)
class CertificateCheck:
    """Outcome of verifying a certificate; true where it proves what it says.

    Attributes
    ----------
    valid : bool
    smallest_eigenvalue : float
        Of the blocks at the witness, or of the dual matrices.
    gap : float
        By how much the dual point contradicts feasibility (0 for a witness).
    residual : float
        Largest error of the linear equations that the certificate must satisfy.
    reach : float
        Size (sum of absolute values of the unidentifiable parameters, SI units) up to which infeasibility is proved in
        spite of the residual; infinite without residual.
    """

    valid: bool
    smallest_eigenvalue: float
    gap: float
    residual: float
    reach: float

    def __bool__(self) -> bool:
        return self.valid


@dataclass(frozen=True, eq=False)
class FeasibilityCertificate:
    """Standard parameters δ of a real robot that has the base parameters β: K δ = β, D(δ) ≻ 0 (thesis 3.34).

    Attributes
    ----------
    feasible_set : FeasibleSet
    base : (n_b,)
    parameters : (n,)
    """

    feasible_set: FeasibleSet = field(repr=False)
    base: Vector = field(repr=False)
    parameters: Vector = field(repr=False)

    def verify(self) -> CertificateCheck:
        """Factorise every block anew, and compare K δ with β."""
        feasible = self.feasible_set
        error = np.abs(feasible.K @ self.parameters - self.base)
        scale = np.abs(feasible.K) @ np.abs(self.parameters) + np.abs(self.base)
        same = bool(np.all(error <= 1e-12 * scale))
        eigenvalues = feasible.stack.smallest_eigenvalues(self.parameters)
        return CertificateCheck(
            valid=same and feasible.contains(self.parameters),
            smallest_eigenvalue=float(eigenvalues.min(initial=np.inf)),
            gap=0.0,
            residual=float(error.max(initial=0.0)),
            reach=np.inf,
        )

    def to_dict(self) -> dict[str, Any]:
        """As plain numbers, for JSON."""
        return {
            "kind": "feasible",
            "consistency": self.feasible_set.consistency,
            "base": self.base.tolist(),
            "parameters": self.parameters.tolist(),
        }


@dataclass(frozen=True, eq=False)
class InfeasibilityCertificate:
    """A dual point: matrices Z ⪰ 0 that no feasible parameters with this β can face.

    For every δ with K δ = β and E δ = f, Σ <D_b(δ), Z_b> - yᵀ(E δ - f) has the same value, because Z and y are
    orthogonal to all unidentifiable directions; the value is negative, but would not be if every D_b(δ) were positive
    semidefinite.

    Attributes
    ----------
    feasible_set : FeasibleSet
    base : (n_b,)
    dual : mapping from block name to (d, d)
        Z_b, for the blocks where it is not zero; their traces add to 1.
    equation_multipliers : (r,)
        y.
    """

    feasible_set: FeasibleSet = field(repr=False)
    base: Vector = field(repr=False)
    dual: Mapping[str, Matrix] = field(repr=False)
    equation_multipliers: Vector = field(repr=False)

    def verify(self) -> CertificateCheck:
        """Recompute everything from the model's conditions and the constraints."""
        feasible = self.feasible_set
        gradient = np.zeros(feasible.parameter_count)
        value, magnitude, smallest = 0.0, 0.0, np.inf
        known = {block.name for block in feasible.blocks}
        particular = feasible.lift @ self.base
        for block in feasible.blocks:
            if block.name not in self.dual:
                continue
            dual = np.asarray(self.dual[block.name], dtype=float)
            smallest = min(smallest, float(np.linalg.eigvalsh(dual)[0]))
            np.add.at(gradient, block.indices, np.einsum("cij,ij->c", block.coefficients, dual))
            elements = block.evaluate(particular) * dual
            value += float(elements.sum())
            magnitude += float(np.abs(elements).sum())
        if feasible.equalities:
            gradient -= feasible.equation_matrix.T @ self.equation_multipliers
            error = feasible.equation_matrix @ particular - feasible.equation_values
            value -= float(self.equation_multipliers @ error)
            magnitude += float(np.abs(self.equation_multipliers) @ np.abs(error))
        residual = float(np.abs(feasible.unidentifiable.T @ gradient).max(initial=0.0))
        gap = -value
        reach = gap / residual if residual > 0 else np.inf
        semidefinite = smallest >= -1e-13
        valid = known.issuperset(self.dual) and semidefinite and gap > 1e-13 * magnitude and reach >= LEAST_REACH
        return CertificateCheck(valid, smallest, gap, residual, reach)

    @property
    def blocks(self) -> tuple[tuple[str, float], ...]:
        """Names of the blocks that take part in the contradiction with their share (trace of Z_b), largest first."""
        shares = [(name, float(np.trace(dual))) for name, dual in self.dual.items()]
        return tuple(sorted(shares, key=lambda item: -item[1]))

    def to_dict(self) -> dict[str, Any]:
        """As plain numbers, for JSON."""
        return {
            "kind": "infeasible",
            "consistency": self.feasible_set.consistency,
            "base": self.base.tolist(),
            "dual": {name: np.asarray(dual).tolist() for name, dual in self.dual.items()},
            "equation_multipliers": self.equation_multipliers.tolist(),
        }
