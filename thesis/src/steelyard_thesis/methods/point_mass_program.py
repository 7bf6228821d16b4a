"""The quadratic program of the point masses (thesis 2.76), over masses and the base parameters that they make."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, Rows
from steelyard.errors import InputError
from steelyard.lmi import AffineBlock
from steelyard.robot.inertia import PSEUDO_INERTIA

from .method import Problem

__all__ = ["PointMassProgram"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

INSIDE = 1e-7
"""How far within each 1 x 1 constraint the answer is kept, in units of what is added up there."""


@dataclass(frozen=True, eq=False)
class PointMassProgram:
    """Minimise ½ x'P x + q'x over x = (β - β̂, p, o) in units: base parameters, masses, parameters of the terms.

    Attributes
    ----------
    problem : Problem
    masses_to_inertia : (n, points) sparse
        R (thesis 2.74), all links together.
    typical : (points,)
        Units of the masses.
    goal : (points,)
        p̂ in kg.
    strength : (points,)
        Weight of the squared difference from p̂, in units of the masses and of the squared residual.
    floor : float
        Least mass in units.
    """

    problem: Problem
    masses_to_inertia: sparse.csc_array = field(repr=False)
    typical: Vector = field(repr=False)
    goal: Vector = field(repr=False)
    strength: Vector = field(repr=False)
    floor: float

    @classmethod
    def of(
        cls, problem: Problem, R: Matrix, typical: Vector, goal: Matrix, strength: Vector, floor: float
    ) -> PointMassProgram:
        """Put it together from arrays for each link.

        Parameters
        ----------
        problem : Problem
        R : (links, 10, count)
        typical : (links,)
        goal : (links, count)
        strength : (links,)
        floor : float

        Raises
        ------
        InputError
            If the feasible set has a constraint that is no 1 x 1 block.
        """
        links, _, count = R.shape
        rows = np.broadcast_to(problem.links[:, :, None], R.shape)
        columns = np.broadcast_to(np.arange(links * count).reshape(links, 1, count), R.shape)
        shape = (problem.feasible_set.parameter_count, links * count)
        blocks = sparse.csc_array(sparse.coo_array((R.ravel(), (rows.ravel(), columns.ravel())), shape=shape))
        blocks.eliminate_zeros()
        program = cls(problem, blocks, np.repeat(typical, count), goal.ravel(), np.repeat(strength, count), floor)
        program.refuse_matrices()
        return program

    @property
    def point_count(self) -> int:
        """Number of point masses of all links."""
        return len(self.typical)

    @property
    def base_count(self) -> int:
        """Number of base parameters."""
        return len(self.problem.rho)

    @cached_property
    def scaled(self) -> sparse.csc_array:
        """δ of (p, o) in their units, (n, points + others)."""
        others = self.problem.others
        shape = (self.problem.feasible_set.parameter_count, len(others))
        places = (others, np.arange(len(others)))
        terms = sparse.csc_array(sparse.coo_array((self.problem.units.parameters[others], places), shape=shape))
        masses = self.masses_to_inertia @ sparse.diags_array(self.typical)
        return sparse.csc_array(sparse.hstack([masses, terms], format="csc"))

    @cached_property
    def lower(self) -> Vector:
        """Lower bounds of (p, o) in their units, -inf where none."""
        others = self.problem.others
        bounds = self.problem.lower_bounds[others] / self.problem.units.parameters[others]
        return np.concatenate([np.full(self.point_count, self.floor), bounds])

    @cached_property
    def constraint_blocks(self) -> tuple[AffineBlock, ...]:
        """The 1 x 1 blocks that are neither bounds of a single parameter of a term nor true of all these points."""
        return tuple(
            block
            for block in self.problem.feasible_set.blocks
            if block.kind != "link" and block.size == 1 and not self._is_bound(block) and not self._holds(block)
        )

    def _holds(self, block: AffineBlock) -> bool:
        """Return whether it holds whatever the masses are, such as a box around all points of a link."""
        row = np.zeros(self.problem.feasible_set.parameter_count)
        np.add.at(row, block.indices, block.coefficients[:, 0, 0])
        made = np.asarray(row @ self.masses_to_inertia)
        size = float(np.abs(made).max(initial=0.0))
        alone = not np.any(row[self.problem.others])
        return alone and float(block.constant[0, 0]) >= 0.0 and float(made.min(initial=0.0)) >= -1e-12 * size

    def _is_bound(self, block: AffineBlock) -> bool:
        alone = len(block.indices) == 1 and float(block.coefficients[0, 0, 0]) > 0.0
        return alone and int(block.indices[0]) in self.problem.others

    def refuse_matrices(self) -> None:
        """Refuse conditions that are no linear inequalities; that a density exists holds for point masses anyway.

        Raises
        ------
        InputError
        """
        for block in self.problem.feasible_set.blocks:
            if block.kind == "link" or block.size == 1:
                continue
            if block.coefficients.shape == PSEUDO_INERTIA.shape and np.array_equal(block.coefficients, PSEUDO_INERTIA):
                continue
            raise InputError(
                f"{block.name}: point masses are found by a quadratic program, which takes linear conditions alone; "
                "leave this constraint out, or use steelyard.fit."
            )

    @cached_property
    def has_bounds_alone(self) -> bool:
        """Whether every condition is a lower bound of an unknown."""
        return not self.constraint_blocks and not self.problem.feasible_set.equalities

    @property
    def has_goal(self) -> bool:
        """Whether masses are known before."""
        return bool(np.any(self.goal))

    def conic(self) -> ConicProblem:
        """The program with sparse matrices: objective over β alone, β = K R p as equations."""
        feasible_set, regression, count = self.problem.feasible_set, self.problem.regression, self.base_count
        scaled = self.scaled
        makes = sparse.csc_array(sparse.csc_array(feasible_set.K) @ scaled)
        units = np.abs(feasible_set.K) @ self.problem.units.parameters
        units = np.where(units > 0.0, units, 1.0)
        columns = np.concatenate([units, np.ones(scaled.shape[1])])
        data = regression.objective(columns, regression.base, regression.scale)
        places = slice(count, count + self.point_count)
        weights, goals = np.zeros(len(data.q)), np.zeros(len(data.q))
        weights[places], goals[places] = self.strength, self.goal / self.typical
        beside = (sparse.csc_array(sparse.eye_array(count)), -sparse.diags_array(1.0 / units) @ makes)
        parts = [Rows(sparse.csc_array(sparse.hstack(beside)), -regression.base / units, Cone("zero", count))]
        if feasible_set.equalities:
            rows, values = feasible_set.equation_matrix @ scaled, feasible_set.equation_values
            sizes = np.abs(rows).max(axis=1, initial=1e-300)
            left = np.hstack([np.zeros((len(values), count)), rows / sizes[:, None]])
            parts.append(Rows(left, values / sizes, Cone("zero", len(values))))
        parts += data.rows
        bounded = np.flatnonzero(np.isfinite(self.lower))
        select = sparse.coo_array(
            (-np.ones(len(bounded)), (np.arange(len(bounded)), count + bounded)),
            shape=(len(bounded), count + scaled.shape[1]),
        )
        parts.append(Rows(select, -self.lower[bounded], Cone("nonnegative", len(bounded))))
        rows, constants = self._constraint_rows()
        left = np.hstack([np.zeros((len(constants), count)), -rows])
        parts.append(Rows(left, constants, Cone("nonnegative", len(constants))))
        P = sparse.csc_array(data.P + sparse.diags_array(2.0 * weights))
        return ConicProblem.from_rows(data.q - 2.0 * weights * goals, parts, P)

    def _constraint_rows(self) -> tuple[Matrix, Vector]:
        """Rows a and constants c of a·(p, o) + c ≥ 0, scaled, a little within."""
        dense = np.zeros((len(self.constraint_blocks), self.problem.feasible_set.parameter_count))
        constants = np.zeros(len(dense))
        for row, block in enumerate(self.constraint_blocks):
            np.add.at(dense[row], block.indices, block.coefficients[:, 0, 0])
            constants[row] = block.constant[0, 0]
        rows = np.asarray(dense @ self.scaled).reshape(len(dense), self.scaled.shape[1])
        sizes = np.maximum(np.abs(rows).max(axis=1, initial=0.0), np.abs(constants))
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        return rows / sizes[:, None], constants / sizes - INSIDE

    def dense(self) -> tuple[Matrix, Vector]:
        """Return A and b of min ‖A (p, o) - b‖² in units, without the conditions."""
        root = np.sqrt(self.problem.regression.scale)
        A = np.asarray(self.problem.matrix @ self.scaled) / root
        b = self.problem.rho / root
        if self.has_goal:
            weights = np.sqrt(self.strength)
            ridge = np.zeros((self.point_count, A.shape[1]))
            ridge[:, : self.point_count] = np.diag(weights)
            A, b = np.vstack([A, ridge]), np.concatenate([b, weights * self.goal / self.typical])
        return A, b

    def parameters(self, unknowns: Vector, floor: float | None = None) -> Vector:
        """δ of (p, o) in units, raised to their bounds; equations of constraints are met."""
        lower = self.lower.copy()
        if floor is not None:
            lower[: self.point_count] = floor
        found = np.asarray(self.scaled @ np.maximum(unknowns, lower))
        return self.problem.feasible_set.project_on_equations(found)
