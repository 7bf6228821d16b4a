"""Least squares under nonlinear conditions on links, with first and second derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.errors import InputError

from .link_conditions import LinkConditions, inertia_about_com
from .method import Problem

__all__ = ["NonlinearProgram"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

LIGHTEST = 1e-9
"""Masses stay above this part of the link's unit, so that the inertia about the centre of mass exists."""

SATISFIED = 1e-8
"""Conditions in scaled units may lack this much at an iterate that counts as feasible; the margin makes up for it."""


@dataclass(frozen=True, eq=False)
class NonlinearProgram:
    """Minimise λ_ω ‖R K δ - ρ‖² + λ_β ‖β̂ - K δ‖² (thesis 2.69) over masses and conditions that are not negative.

    The unknowns x are parameters in units of their link, less the margin of the set, so that conditions that are not
    negative mean D(δ) - ε 1 ⪰ 0, as in `steelyard.fit`.

    Attributes
    ----------
    problem : Problem
    conditions : LinkConditions
    residual_weight, prior_weight : float
        λ_ω, λ_β.
    prior_base : (n_b,) or None
        β̂, NaN where unknown.
    triangle : bool
        Whether the conditions are those of "full" consistency.
    """

    problem: Problem
    conditions: LinkConditions
    residual_weight: float = 1.0
    prior_weight: float = 0.0
    prior_base: Vector | None = None
    triangle: bool = False

    @cached_property
    def units(self) -> Vector:
        """Unit of each unknown, (n,)."""
        return self.problem.units.parameters

    @cached_property
    def shift(self) -> Vector:
        """The parameters at x = 0, (n,): those whose matrices D are ε 1, and the lower bounds of terms."""
        bounds = self._term_bounds
        links = self.problem.margin_shift(self.triangle)
        return np.asarray(np.where(np.isfinite(bounds), bounds + self.problem.feasible_set.margin, links))

    @cached_property
    def _term_bounds(self) -> Vector:
        """Lower bounds of what is not an inertial parameter, (n,); -inf where none."""
        found = np.full(len(self.units), -np.inf)
        found[self.problem.others] = self.problem.lower_bounds[self.problem.others]
        return found

    @cached_property
    def quadratic(self) -> tuple[Matrix, Vector, float]:
        """H, c and the constant of ½ xᵀ H x - cᵀ x + constant, in units of the squared residual of least squares."""
        problem, scale = self.problem, self.problem.regression.scale
        rows = np.sqrt(self.residual_weight / scale) * (problem.matrix * self.units)
        base = problem.feasible_set.K @ self.shift
        right = np.sqrt(self.residual_weight / scale) * (problem.rho - problem.R @ base)
        if self.prior_weight > 0.0 and self.prior_base is not None:
            known = ~np.isnan(self.prior_base)
            weight = np.sqrt(self.prior_weight / scale)
            rows = np.vstack([rows, weight * (problem.feasible_set.K * self.units)[known]])
            right = np.concatenate([right, weight * (self.prior_base - base)[known]])
        return 2.0 * rows.T @ rows, 2.0 * rows.T @ right, float(right @ right)

    @cached_property
    def lower(self) -> Vector:
        """Least value of each unknown, (n,)."""
        found = np.where(np.isfinite(self._term_bounds), 0.0, -np.inf)
        found[self.problem.links[:, 9]] = LIGHTEST
        return np.asarray(found)

    @cached_property
    def linear(self) -> tuple[Matrix, Vector, Matrix, Vector]:
        """The constraints of the set that are linear in x: A x + a ≥ 0 and E x = e.

        Raises
        ------
        InputError
            If a constraint is not linear.
        """
        feasible_set, n = self.problem.feasible_set, len(self.units)
        rows, values = [], []
        for block in feasible_set.blocks:
            single = block.size == 1 and len(block.indices) == 1 and block.coefficients.item() > 0.0
            if block.kind == "link" or (single and block.indices[0] in self.problem.others):
                continue  # conditions of the links and lower bounds of terms are stated elsewhere
            if block.size > 1:
                raise InputError(
                    f"general nonlinear solvers are given linear constraints alone here, but {block.name!r} is a "
                    f"matrix of order {block.size}; leave it out, or use steelyard.fit."
                )
            row = np.zeros(n)
            np.add.at(row, block.indices, block.coefficients[:, 0, 0])
            size = float(np.linalg.norm(row * self.units)) or 1.0
            rows.append(row * self.units / size)
            values.append((block.constant[0, 0] + row @ self.shift - feasible_set.margin) / size)
        E, e = feasible_set.equation_matrix, feasible_set.equation_values
        left = E * self.units
        sizes = np.maximum(np.linalg.norm(left, axis=1), 1e-300)
        equal = (e - E @ self.shift) / sizes
        return np.reshape(rows, (-1, n)), np.array(values), left / sizes[:, None], equal

    def to_parameters(self, x: Vector) -> Vector:
        """δ of x."""
        return np.asarray(x * self.units + self.shift)

    def to_unknowns(self, parameters: Vector) -> Vector:
        """Return x of δ, within its bounds."""
        return np.maximum((parameters - self.shift) / self.units, self.lower)

    def objective(self, x: Vector) -> float:
        """Return the value of the objective."""
        H, c, constant = self.quadratic
        return float(0.5 * x @ (H @ x) - c @ x + constant)

    def gradient(self, x: Vector) -> Vector:
        """Return the first derivatives of `objective`, (n,)."""
        H, c, _ = self.quadratic
        return np.asarray(H @ x - c)

    def constraints(self, x: Vector) -> Vector:
        """Return the values that must not be negative, (links c + rows,)."""
        A, a, _, _ = self.linear
        return np.concatenate([self.conditions.values(x[self.problem.links]).ravel(), A @ x + a])

    @cached_property
    def places(self) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Rows and columns of the derivatives of link conditions."""
        count = self.conditions.count * len(self.problem.links)
        return np.repeat(np.arange(count), 10), np.repeat(self.problem.links, self.conditions.count, axis=0).ravel()

    def jacobian(self, x: Vector) -> Matrix:
        """First derivatives of `constraints`, dense."""
        A = self.linear[0]
        count = self.conditions.count * len(self.problem.links)
        found = np.zeros((count + len(A), len(x)))
        found[self.places] = self.conditions.jacobian(x[self.problem.links]).ravel()
        found[count:] = A
        return found

    def sparse_jacobian(self, x: Vector) -> sparse.csr_array:
        """Return `jacobian` as a sparse array."""
        A = self.linear[0]
        count = self.conditions.count * len(self.problem.links)
        values = self.conditions.jacobian(x[self.problem.links]).ravel()
        upper = sparse.csr_array((values, self.places), shape=(count, len(x)))
        return sparse.csr_array(sparse.vstack([upper, sparse.csr_array(A)]) if len(A) else upper)

    def curvature(self, x: Vector, multipliers: Vector) -> Matrix:
        """Second derivatives of `constraints`, summed with multipliers, (n, n)."""
        links = self.problem.links
        count = self.conditions.count * len(links)
        blocks = self.conditions.curvature(x[links], multipliers[:count].reshape(len(links), -1))
        found = np.zeros((len(x), len(x)))
        found[links[:, :, None], links[:, None, :]] = blocks
        return found

    def possible(self, x: Vector) -> bool:
        """Tell whether masses and inertias about the centre of mass are positive, and all else holds up to rounding."""
        inertial = x[self.problem.links]
        if inertial[:, 9].min(initial=1.0) <= 0.0 or not np.all(np.isfinite(x)):
            return False
        tensors = inertia_about_com(inertial)
        values = np.linalg.eigvalsh(tensors)
        if self.triangle:
            values = 0.5 * values.sum(axis=1, keepdims=True) - values
        A, a, E, e = self.linear
        rest = np.concatenate([values.ravel(), A @ x + a, -np.abs(E @ x - e), np.minimum(x - self.lower, 0.0)])
        return bool(rest.min(initial=0.0) >= -SATISFIED)
