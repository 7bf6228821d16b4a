"""The conditions at given base parameters, as a conic problem in the parameters that the motion does not show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem
from steelyard.lmi import AffineBlock, AffineStack

from ..feasible_set import FeasibleSet

__all__ = ["BlockProblem"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

ROUNDING = 1e-10
"""Coefficients below this, relative to the largest of their parameter in the block, are what cancelling leaves."""


@dataclass(frozen=True, eq=False)
class BlockProblem:
    """Blocks Tᵀ D(δ) T with δ = particular + (P_d - P_b K_d) δ_d (thesis 3.35), each with a T of its own.

    Attributes
    ----------
    feasible : FeasibleSet
    particular : (n,)
        P_b β, or another δ with K δ = β.
    used : tuple of int
        Indices of the blocks that are there; those whose T has no column are not.
    stack : AffineStack
        As functions of δ_d.
    """

    feasible: FeasibleSet
    particular: Vector
    used: tuple[int, ...]
    stack: AffineStack

    @classmethod
    def of(
        cls,
        feasible: FeasibleSet,
        particular: Vector,
        bases: Sequence[Matrix],
        scalings: Sequence[Matrix] | None = None,
    ) -> "BlockProblem":
        """Substitute δ = particular + (P_d - P_b K_d) δ_d into the blocks.

        Parameters
        ----------
        feasible : FeasibleSet
        particular : (n,)
            Some δ with the base parameters β, such as P_b β.
        bases : sequence of (d, r)
            U.
        scalings : sequence of (r, r), optional
            C, with T = U C; unit matrices where absent.
        """
        directions = feasible.unidentifiable
        used, blocks = [], []
        for index, (block, basis) in enumerate(zip(feasible.blocks, bases, strict=True)):
            if not basis.shape[1]:
                continue
            used.append(index)
            found = block.substitute(directions, particular)
            constant, coefficients = _congruent(found.constant, basis), _congruent(found.coefficients, basis)
            # What cancels leaves rounding, which a solver would take for something that a large number can make use of.
            size = np.abs(found.coefficients).max(axis=(1, 2), initial=0.0) * float(np.abs(basis).max()) ** 2
            coefficients[np.abs(coefficients) <= ROUNDING * size[:, None, None]] = 0.0
            if scalings is not None:
                constant = _congruent(constant, scalings[index])
                coefficients = _congruent(coefficients, scalings[index])
            blocks.append(AffineBlock(found.name, constant, found.indices, coefficients, found.kind))
        return cls(feasible, particular, tuple(used), AffineStack(tuple(blocks), directions.shape[1]))

    def parameters(self, dependent: Vector) -> Vector:
        """δ from δ_d."""
        return self.feasible.project_on_equations(self.particular + self.feasible.unidentifiable @ dependent)

    def conic(self, slack: sparse.csc_array, cost: Vector, bounds: Matrix, trace_bound: float | None) -> ConicProblem:
        """Minimise costᵀ s subject to blocks + slack s ⪰ 0, bounds [s, 1] ≥ 0, the equations and the trace bound.

        The trace bound is on the sum of the traces of the blocks of links and terms.
        """
        feasible, stack = self.feasible, self.stack
        unknowns, extra = stack.parameter_count, len(cost)
        equations = feasible.equation_matrix @ feasible.unidentifiable
        equation_values = feasible.equation_values - feasible.equation_matrix @ self.particular
        trace, constant = np.zeros((0, unknowns)), np.zeros(0)
        if trace_bound is not None:
            trace, constant = np.zeros((1, unknowns)), np.array([trace_bound])
            for block in stack.blocks:
                if block.kind != "constraint":
                    np.add.at(trace[0], block.indices, np.trace(block.coefficients, axis1=1, axis2=2))
                    constant[0] -= np.trace(block.constant)
        rows = [
            sparse.hstack([sparse.csc_array(equations), sparse.csc_array((len(equations), extra))]),
            sparse.hstack([sparse.csc_array(trace), sparse.csc_array((len(trace), extra))]),
            sparse.hstack([sparse.csc_array((len(bounds), unknowns)), sparse.csc_array(-bounds[:, :-1])]),
            sparse.hstack([-stack.coefficients, -slack]),
        ]
        return ConicProblem(
            P=sparse.csc_array((unknowns + extra, unknowns + extra)),
            q=np.concatenate([np.zeros(unknowns), cost]),
            A=sparse.csc_array(sparse.vstack(rows, format="csc")),
            b=np.concatenate([equation_values, constant, bounds[:, -1], stack.constant]),
            cones=(
                Cone("zero", len(equations)),
                Cone("nonnegative", len(trace) + len(bounds) + stack.scalar_count),
                *(Cone("semidefinite", size) for size in stack.matrix_sizes),
            ),
        )


def _congruent(matrices: Matrix, transform: Matrix) -> Matrix:
    product = transform.T @ matrices @ transform
    return np.asarray((product + product.swapaxes(-1, -2)) / 2)
