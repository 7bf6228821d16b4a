"""Least values of many linear objectives over one set that is round in its own units."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from steelyard.conic import Outcome

from .bounded_face import BoundedFace, bounded_face
from .round_problem import DualPoint, RoundProblem

__all__ = ["Certify", "Found", "Search"]

Vector = npt.NDArray[np.float64]

TIGHT = 1e-6
"""Gap between what is proved and what is attained, relative to both, that needs no better proof."""

WIDE = 1e-4
"""Gap, in units of the set, that is worth another attempt to find a better point."""

STRAIN = 1e-2
"""Where there is no dual point, the error of the equations times its size is a quarter or more, however small."""

Certify = Callable[[DualPoint, float], float]
"""From a dual point, for an objective of length 1, and that objective's true length, to the least value it proves."""


@dataclass(frozen=True, eq=False)
class Found:
    """What is known of the least value of an objective.

    Attributes
    ----------
    point : (q,) or None
        Inside; None where the objective falls along a ray.
    proved : float
        No point has less; -inf where it is not bounded.
    """

    point: Vector | None = field(repr=False)
    proved: float


class Search:
    """One problem, solved for many objectives, on its faces where it must be.

    Parameters
    ----------
    problem : RoundProblem
    """

    def __init__(self, problem: RoundProblem) -> None:
        self.problem = problem

    def least(self, objective: Vector, certify: Certify) -> Found:
        """The least value of objective · v.

        Parameters
        ----------
        objective : (q,)
            Not zero.
        certify : callable
            Tells what a dual point proves.
        """
        problem = self.problem
        length = float(np.linalg.norm(objective))
        unit = objective / length
        general = self._general_face
        known = general.bounds(unit)
        # On a face the solver does not stall; the whole problem then need only give a point.
        rough = known and general.loose.shape[1] > 0
        solution = problem.least(unit, rough)
        if not known and solution.outcome is Outcome.UNBOUNDED and self._is_ray(solution.point, unit):
            return Found(None, -np.inf)
        point = problem.pulled_inside(solution.point)
        proved = -np.inf
        if not rough:
            attained = float(objective @ point)
            proved = certify(solution.dual, length)
            sound = known or -proved <= length * problem.order or problem.strain(unit, solution.dual) < STRAIN
            if sound and attained - proved <= TIGHT * max(length, -attained):
                return Found(point, proved)
        face = general if known else bounded_face(problem, unit)
        if not face.bounds(unit):
            return Found(point, -np.inf)
        proved = max(proved, certify(face.least(unit), length))
        if rough and float(objective @ point) - proved > WIDE * length:
            other = problem.pulled_inside(problem.least(unit).point)
            point = min(point, other, key=lambda v: float(objective @ v))
        return Found(point, proved)

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
