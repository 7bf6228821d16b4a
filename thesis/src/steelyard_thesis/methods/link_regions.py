"""The regions in which the virtual parameters of one link are looked for, given those of the links beyond it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.conic import Cone, ConicProblem, Rows, solve
from steelyard.feasibility import FeasibleSet
from steelyard.lmi import AffineBlock
from steelyard.lmi.affine import symmetric_to_vector, vector_to_symmetric

__all__ = ["Demand", "LinkRegion", "regions_of_links"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

ACCURACY = 1e-10
"""Accuracy that the solver is asked for; margins smaller than 1e-9 are decided by it."""

CAP = 1.0
"""Largest margin that is looked for, so that the problem is bounded."""

SMALL_MARGIN = 1e-4
"""Margin that light choices keep where there is room for it."""


@dataclass(frozen=True, eq=False)
class Demand:
    """A condition of a link on the links beyond it: row · δ + constant ≥ 0 for all feasible δ.

    Attributes
    ----------
    row : (n,)
    constant : float
    link : int
        Which link demands it.
    """

    row: Vector = field(repr=False)
    constant: float
    link: int


@dataclass(frozen=True, eq=False)
class LinkRegion:
    """The dependent parameters of one link, and the conditions that they complete.

    Attributes
    ----------
    feasible_set : FeasibleSet
    link : int
    title : str
    columns : (d,)
        Of `FeasibleSet.unidentifiable`: the unknowns.
    blocks : tuple of AffineBlock
    """

    feasible_set: FeasibleSet = field(repr=False)
    link: int
    title: str
    columns: Indices = field(repr=False)
    blocks: tuple[AffineBlock, ...] = field(repr=False)

    @property
    def dimension(self) -> int:
        """Number of unknowns."""
        return len(self.columns)

    @property
    def directions(self) -> Matrix:
        """How δ changes with the unknowns, (n, d)."""
        return self.feasible_set.unidentifiable[:, self.columns]

    def _stacked(self, origin: Vector, demands: list[Demand]) -> tuple[Matrix, Vector, Vector, tuple[Cone, ...]]:
        """Coefficients of the unknowns, values at the origin, unit matrices and cones; 1 x 1 conditions first."""
        directions = self.directions
        small = [b for b in self.blocks if b.size == 1]
        large = [b for b in self.blocks if b.size > 1]
        coefficients, values, units = [], [], []
        for demand in demands:
            scale = max(float(np.abs(demand.row).max()), 1e-300)
            coefficients.append((demand.row @ directions / scale)[None, :])
            values.append(np.array([(demand.row @ origin + demand.constant) / scale]))
            units.append(np.ones(1))
        for block in (*small, *large):
            slopes = np.tensordot(directions[block.indices].T, block.coefficients, axes=1)
            coefficients.append(symmetric_to_vector(slopes).T)
            values.append(symmetric_to_vector(block.evaluate(origin)))
            units.append(symmetric_to_vector(np.eye(block.size)))
        cones = (
            Cone("nonnegative", len(demands) + len(small)),
            *(Cone("semidefinite", block.size) for block in large),
        )
        return np.vstack(coefficients), np.concatenate(values), np.concatenate(units), cones

    def middle(self, origin: Vector, demands: list[Demand]) -> tuple[float, Vector, Demand | None]:
        """Return the largest margin t, where it is reached, and, where t < 0, what it demands of the links beyond.

        Parameters
        ----------
        origin : (n,)
            δ where the unknowns of this link are zero.
        demands : list of Demand
            That this link must meet.

        Returns
        -------
        tuple
            NaN where the solver fails.
        """
        coefficients, values, units, cones = self._stacked(origin, demands)
        count = self.dimension
        rows = np.hstack([-coefficients, units[:, None]])
        cap = np.append(np.zeros(count), 1.0)
        cones = (Cone("nonnegative", 1), *cones)
        found = solve(
            ConicProblem.from_rows(
                np.append(np.zeros(count), -1.0), [Rows(np.vstack([cap, rows]), np.append(CAP, values), *cones)]
            ),
            accuracy=ACCURACY,
        )
        if not found.outcome.usable or not np.all(np.isfinite(found.primal)):
            return float("nan"), np.zeros(count), None
        margin = float(found.primal[-1])
        demand = self._demand(found.dual[1:], demands) if margin < 0.0 else None
        return margin, np.asarray(found.primal[:count]), demand

    def extreme(self, origin: Vector, demands: list[Demand], margin: float, objective: Vector) -> Vector | None:
        """Return the unknowns of least objective that keep a margin; None where the solver fails."""
        coefficients, values, units, cones = self._stacked(origin, demands)
        found = solve(
            ConicProblem.from_rows(objective, [Rows(-coefficients, values - margin * units, *cones)]), accuracy=ACCURACY
        )
        good = found.outcome.usable and bool(np.all(np.isfinite(found.primal)))
        return np.asarray(found.primal) if good else None

    def _demand(self, dual: Vector, demands: list[Demand]) -> Demand:
        """The combination of conditions in which the unknowns of this link cancel."""
        row, constant = np.zeros(self.feasible_set.parameter_count), 0.0
        position = 0
        for demand in demands:
            weight = max(float(dual[position]), 0.0) / max(float(np.abs(demand.row).max()), 1e-300)
            row += weight * demand.row
            constant += weight * demand.constant
            position += 1
        for block in (*(b for b in self.blocks if b.size == 1), *(b for b in self.blocks if b.size > 1)):
            length = block.size * (block.size + 1) // 2
            matrix = vector_to_symmetric(dual[position : position + length])
            eigenvalues, vectors = np.linalg.eigh(matrix)
            matrix = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
            np.add.at(row, block.indices, np.einsum("kij,ij->k", block.coefficients, matrix))
            constant += float(np.sum(block.constant * matrix))
            position += length
        return Demand(row, constant, self.link)


def regions_of_links(feasible_set: FeasibleSet) -> tuple[list[LinkRegion], list[AffineBlock]]:
    """Return the regions from the tip to the base, and the blocks that base parameters determine alone.

    A dependent parameter belongs to the link at which it stands in the order of the parameters; a block belongs to the
    link closest to the base of those on whose dependent parameters it depends, with which it is complete.

    Parameters
    ----------
    feasible_set : FeasibleSet
    """
    names = [str(name) for name in feasible_set.model.robot.link_names]
    dependent = np.asarray(feasible_set.model.base_parameters().dependent, dtype=np.intp)
    starts = feasible_set.link_columns[:, 0]
    order = np.argsort(starts)
    owner = order[np.maximum(np.searchsorted(starts[order], dependent, side="right") - 1, 0)]
    unidentifiable = feasible_set.unidentifiable
    members: dict[int, list[AffineBlock]] = {}
    known = []
    for block in feasible_set.blocks:
        used = np.flatnonzero(np.any(unidentifiable[block.indices] != 0.0, axis=0))
        if len(used):
            members.setdefault(int(owner[used].min()), []).append(block)
        else:
            known.append(block)
    regions = []
    for link in range(len(names) - 1, -1, -1):
        columns = np.flatnonzero(owner == link)
        title = f"link {link + 1} ({names[link]})"
        if len(columns) or link in members:
            regions.append(LinkRegion(feasible_set, link, title, columns, tuple(members.get(link, ()))))
    return regions, known
