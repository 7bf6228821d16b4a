"""Least values of a combination of parameters, or of a ratio of two, over a section of the feasible set.

Every answer has two values: the proved one, below which nothing is (`DualBound`), and the attained one, at parameters
that were found inside the set. The truth lies between the two.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..conic import Outcome
from .bounded_face import BoundedFace, bounded_face
from .center import Middle
from .dual_bound import EPSILON, DualBound
from .round_problem import Ball, RoundProblem
from .section import BlockGroup

__all__ = ["Bound", "BoundFinder"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

TIGHT = 1e-6
"""Gap between the two values, in units of the section, that needs no better proof."""

WIDE = 1e-4
"""Gap, in the same units, that is worth another attempt to find a better point."""

SMALLEST_MASS = 1e-3
"""A ratio is proved where its denominator is at least this part of what it is in the middle (or its own least
value)."""


LOOSE_RATIO = 1e-3
"""Gap between the two values of a ratio, in units of the section, that is allowed where the mass may vanish."""

ROOM = 1e-8
"""Part of the size of a ratio's interval that is given away for mending."""


@dataclass(frozen=True, eq=False)
class Bound:
    """The least value of a quantity.

    Attributes
    ----------
    proved : float
        No parameters of the section have less; -inf where it is not bounded.
    attained : float
        A value that is reached.
    parameters : (n,) or None
        Where it is reached.
    """

    proved: float
    attained: float
    parameters: Vector | None = field(repr=False)


Certify = Callable[[tuple[Matrix, ...], Vector, float], float]
"""From dual matrices and the dual of the ball, for an objective of length 1, and the value they speak of, to what
they prove."""

UNBOUNDED = Bound(-np.inf, -np.inf, None)


class BoundFinder:
    """Least values over one section; only the objective changes from one to the next.

    Parameters
    ----------
    middle : Middle
    solver : str
        As in `steelyard.feasibility.solve`.
    """

    def __init__(self, middle: Middle, solver: str = "clarabel") -> None:
        self.middle = middle
        self.solver = solver
        self._dual = DualBound(middle)
        count = len(middle.centre)
        first, second = middle.ball
        ball = Ball(first, second, np.zeros(count)) if len(first) else None
        self._search = _Search(RoundProblem(middle.groups, ball, count, solver))
        self._ratios: dict[bytes, _Search] = {}

    @property
    def reach(self) -> float:
        """The proofs hold for parameters whose blocks have traces (kg, kg m², ...) that add to less than this."""
        return self._dual.reach

    def least(self, row: Vector) -> Bound:
        """The least value of row · δ.

        Parameters
        ----------
        row : (n,)
        """
        section, middle = self.middle.section, self.middle
        value = float(row @ middle.parameters)
        if section.is_decided(row):
            return Bound(value - self._rounding(row), value, middle.parameters)
        if not section.is_seen(row):
            return UNBOUNDED
        objective = middle.directions.T @ row
        found = self._search.least(objective, lambda duals, pull, _: self._dual.of(row, duals, pull) - value)
        if found is None:
            return UNBOUNDED
        point, proved = found
        parameters = middle.parameters + middle.directions @ point
        attained = float(row @ parameters)
        return Bound(min(value + proved, attained - self._rounding(row)), attained, parameters)

    def least_ratio(self, row: Vector, mass: Vector, least_mass: float) -> Bound:
        """The least value of (row · δ) / (mass · δ), for a mass that is positive all over the section.

        In the unknowns (τ, τ δ) with a mass of 1 the problem is linear (Charnes and Cooper, 1962).

        Parameters
        ----------
        row, mass : (n,)
        least_mass : float
            Proved lower bound of the mass.
        """
        section, middle = self.middle.section, self.middle
        if not section.is_seen(row):
            return UNBOUNDED
        weight = float(mass @ middle.parameters)
        ratio = float(row @ middle.parameters) / weight
        rates = middle.directions.T @ mass
        objective = middle.directions.T @ (row - ratio * mass)
        floor = max(least_mass, SMALLEST_MASS * weight)
        whole, room = float(np.linalg.norm(objective)), self._mass_duals(mass)

        def certify(duals: tuple[Matrix, ...], pull: Vector, value: float) -> float:
            # Where row - (ratio + value) mass is nowhere below -x, no ratio is below by more than x / mass. A little
            # less than that value leaves room for mending where the ratio is that of an infinite mass.
            value -= ROOM * whole
            aim = row - (ratio + value) * mass
            length = float(np.linalg.norm(middle.directions.T @ aim))
            own = duals[-len(middle.groups) :]
            unit = whole / length if length > 0 else 1.0
            mixed = tuple(unit * (weight * Z + ROOM * E) for Z, E in zip(own, room, strict=True))
            return value + min(0.0, self._dual.of(aim, mixed, unit * weight * pull)) / floor

        if float(np.linalg.norm(objective)) <= 1e-12 * float(np.abs(row) @ np.abs(middle.directions).sum(axis=1)):
            return Bound(ratio - self._rounding(row) / floor, ratio, middle.parameters)
        found = self._ratio_search(mass, rates, weight).least(objective, certify)
        if found is None:
            return UNBOUNDED
        point, proved = found
        if least_mass <= 0.0 and float(objective @ point) - proved > LOOSE_RATIO * whole:
            # Where the mass may vanish, nothing is proved by a bound for masses above the floor.
            return UNBOUNDED
        share = 1.0 - float(rates @ point)
        parameters = middle.parameters + weight * middle.directions @ point / share
        attained = float(row @ parameters) / float(mass @ parameters)
        return Bound(min(ratio + proved, attained - self._rounding(row) / floor), attained, parameters)

    def _ratio_search(self, mass: Vector, rates: Vector, weight: float) -> "_Search":
        """The problem in (τ, τ δ) around the middle, where τ = (1 - rates · v) / weight."""
        key = mass.tobytes()
        if key not in self._ratios:
            middle = self.middle
            positive = BlockGroup(1, np.array([-1]), np.ones((1, 1, 1)), -rates[None, :, None, None])
            groups = [
                BlockGroup(
                    group.size,
                    group.indices,
                    group.constants,
                    weight * group.coefficients - rates[None, :, None, None] * np.eye(group.size),
                )
                for group in middle.groups
            ]
            first, second = middle.ball
            ball = Ball(first, weight * second - np.outer(first, rates), -rates) if len(first) else None
            self._ratios[key] = _Search(RoundProblem((positive, *groups), ball, len(rates), self.solver))
        return self._ratios[key]

    def _mass_duals(self, mass: Vector) -> tuple[Matrix, ...]:
        """Z of each group with Σ <D_b, Z_b> = mass · δ, in the units of the middle; zero where no block says so."""
        feasible, found = self.middle.section.feasible, []
        for group, inverse in zip(self.middle.groups, self.middle.factors, strict=True):
            matrices = np.zeros(group.constants.shape)
            for position, index in enumerate(group.indices):
                block = feasible.blocks[index]
                diagonal = np.zeros((block.size, len(mass)))
                diagonal[:, block.indices] = np.diagonal(block.coefficients, axis1=1, axis2=2).T
                same = np.flatnonzero(np.all(diagonal == mass, axis=1) & (np.diagonal(block.constant) == 0))
                root = np.linalg.inv(inverse[position])
                for i in same:
                    matrices[position] += np.outer(root[i], root[i]) / len(same)
            found.append(matrices)
        return tuple(found)

    def _rounding(self, row: Vector) -> float:
        return EPSILON * float(np.abs(row) @ np.abs(self.middle.parameters))


class _Search:
    """One problem, solved for many objectives, on its faces where it must be."""

    def __init__(self, problem: RoundProblem) -> None:
        self.problem = problem

    def least(self, objective: Vector, certify: Certify) -> tuple[Vector, float] | None:
        """A point inside, and the proved least value of objective · v; None where it is not bounded."""
        problem = self.problem
        length = float(np.linalg.norm(objective))
        unit = objective / length
        general = self._general_face
        known = general.bounds(unit)
        # On a face the solver does not stall; the whole problem then need only give a point.
        rough = known and general.loose.shape[1] > 0
        solution = problem.least(unit, rough)
        if not known and solution.outcome is Outcome.UNBOUNDED and self._is_ray(solution.point, unit):
            return None
        point = problem.pulled_inside(solution.point)
        proved = -np.inf
        if not rough:
            attained = float(objective @ point)
            proved = certify(solution.duals, solution.ball_dual, length * solution.dual_value)
            near = known or -proved <= length * problem.order
            if near and attained - proved <= TIGHT * max(length, -attained):
                return point, proved
        face = general if known else bounded_face(problem, unit)
        if not face.bounds(unit):
            return None
        duals, pull, value = face.least(unit)
        proved = max(proved, certify(duals, pull, length * value))
        if rough and float(objective @ point) - proved > WIDE * length:
            other = problem.pulled_inside(problem.least(unit).point)
            point = min(point, other, key=lambda v: float(objective @ v))
        return point, proved

    @cached_property
    def _general_face(self) -> BoundedFace:
        """The face of all objectives that are bounded from both sides."""
        return bounded_face(self.problem)

    def _is_ray(self, point: Vector, unit: Vector) -> bool:
        """Whether the objective falls for ever along a direction that stays inside."""
        size = float(np.linalg.norm(point))
        if not 0 < size < np.inf:
            return False
        ray, ball = point / size, self.problem.ball
        lowest = min(float(np.linalg.eigvalsh(group.change(ray)).min()) for group in self.problem.groups)
        inside = ball is None or float(np.linalg.norm(ball.second @ ray)) < float(ball.rate @ ray) + 1e-8
        return inside and lowest > -1e-8 and float(unit @ ray) < -1e-6
