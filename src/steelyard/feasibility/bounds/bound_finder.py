"""Least values of a combination of parameters, or of a ratio of two, over a slice of the feasible set.

Every answer has two values: a proved lower bound (`SliceBound`), and the attained value at parameters that were found
inside the set. The true minimum lies between them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.conic import Outcome
from steelyard.errors import InputError
from steelyard.once import cached_property
from steelyard.regression import ParameterCovariance

from ..check import check
from ..dual_bound import EPSILON, SliceBound
from ..facial_reduction import MinimalFace, minimal_face
from ..feasible_set import FeasibleSet
from ..nearest_point import light_point, nearest_in_region
from .analytic_center import AnalyticCenter, analytic_center
from .confidence_region import ConfidenceRegion, region_of
from .normalised_problem import Ball, DualPoint, NormalisedProblem
from .slice import BlockGroup, Slice

__all__ = [
    "Bound",
    "BoundFinder",
    "Certify",
    "Found",
    "Given",
    "NoInteriorError",
    "Search",
    "given_base",
    "given_by",
    "given_region",
]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

TIGHT = 1e-6
"""Relative gap between the proved and the attained value at which no better proof is searched for."""

WIDE = 1e-4
"""Gap, in units of the set, above which a second, more accurate solution is tried for a better point."""

STRAIN = 1e-2
"""Largest product of a dual point's size and the error of its equations with which it counts as a dual point. If none
exists, the product is a quarter or more, however small the error."""

Certify = Callable[[DualPoint, float], float]
"""Maps a dual point for an objective of length 1, and the true length of that objective, to the bound that it
proves."""


class NoInteriorError(InputError):
    """The parameters that are left possible are a set without an interior, from which no search can start."""


@dataclass(frozen=True, eq=False)
class Found:
    """A point and a lower bound for the least value of an objective.

    Attributes
    ----------
    point : (q,) or None
        Point inside the set; None if the objective falls along a ray.
    proved : float
        Lower bound of the objective; -inf if it is unbounded.
    """

    point: Vector | None = field(repr=False)
    proved: float


class Search:
    """One problem that is solved for many objectives, on a face of the dual cone where necessary."""

    def __init__(self, problem: NormalisedProblem) -> None:
        self.problem = problem

    def least(self, objective: Vector, certify: Certify) -> Found:
        """The least value of objective · v.

        Parameters
        ----------
        objective : (q,)
            Not zero.
        certify : callable
            Maps a dual point to the bound that it proves.
        """
        problem = self.problem
        length = float(np.linalg.norm(objective))
        unit = objective / length
        general = self._general_face
        known = general.bounds(unit)
        # On a face the solver does not stall. If there is one, the whole problem is solved roughly, for a point only.
        rough = known and general.lineality.shape[1] > 0
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
        face = general if known else minimal_face(problem, unit)
        if not face.bounds(unit):
            return Found(point, -np.inf)
        proved = max(proved, certify(face.least(unit), length))
        if rough and float(objective @ point) - proved > WIDE * length:
            other = problem.pulled_inside(problem.least(unit).point)
            point = min(point, other, key=lambda v: float(objective @ v))
        return Found(point, proved)

    @cached_property
    def _general_face(self) -> MinimalFace:
        """The face for all objectives that are bounded from both sides."""
        return minimal_face(self.problem)

    def _is_ray(self, point: Vector, unit: Vector) -> bool:
        """Return whether the objective falls without bound along a direction that stays inside the set."""
        size = float(np.linalg.norm(point))
        if not 0 < size < np.inf:
            return False
        ray, ball = point / size, self.problem.ball
        lowest = min(float(np.linalg.eigvalsh(group.change(ray)).min()) for group in self.problem.groups)
        inside = ball is None or float(np.linalg.norm(ball.second @ ray)) < float(ball.rate @ ray) + 1e-8
        return inside and lowest > -1e-8 and float(unit @ ray) < -1e-6


WIDE_RATIO = 1e-4
"""Relative gap between the two values of a ratio above which another bound is tried."""

SMALLEST_MASS = 1e-3
"""A ratio is proved where its denominator is at least this part of what it is at the center, or its least value."""


WIDE_AT_NO_MASS = 1e-3
"""Gap between the two values of a ratio, relative to both, that is allowed where the mass may vanish."""

ROOM = 1e-8
"""Part of the size of a ratio's interval by which the bound is lowered, so that mending can change the dual point."""


@dataclass(frozen=True, eq=False)
class Bound:
    """The least value of a quantity.

    Attributes
    ----------
    proved : float
        Lower bound over the slice; -inf if the quantity is unbounded.
    attained : float
        A value that some parameters of the slice have.
    parameters : (n,) or None
        Those parameters, inside the set up to rounding.
    """

    proved: float
    attained: float
    parameters: Vector | None = field(repr=False)


UNBOUNDED = Bound(-np.inf, -np.inf, None)


class RatioProof:
    """What dual points of the problem in (τ, τ δ) prove of a ratio, relative to that at the center.

    Parameters
    ----------
    row, mass : (n,)
        The ratio is (row · δ) / (mass · δ).
    floor : float
        The proofs hold for masses of at least this.
    """

    def __init__(self, finder: "BoundFinder", row: Vector, mass: Vector, floor: float) -> None:
        self.row, self.mass, self.floor = row, mass, floor
        self._center, self._dual = finder.center, finder.dual
        self._weight = float(mass @ self._center.parameters)
        self._ratio = float(row @ self._center.parameters) / self._weight
        self._room = finder.mass_duals(mass)
        self._told: list[tuple[float, float]] = []

    def __call__(self, dual: DualPoint, size: float) -> float:
        """Return the bound that a dual point for an objective of length 1 proves; `size` is its true length."""
        # If row - (ratio + value) mass is at least -x everywhere, no ratio is below ratio + value - x / mass. A
        # slightly smaller value leaves room for mending if the ratio is attained at an infinite mass.
        value = size * (dual.value - ROOM)
        aim = self.row - (self._ratio + value) * self.mass
        length = float(np.linalg.norm(self._center.directions.T @ aim))
        own = dual.matrices[-len(self._center.groups) :]
        unit = size / length if length > 0 else 1.0
        mixed = tuple(unit * (self._weight * Z + ROOM * E) for Z, E in zip(own, self._room, strict=True))
        least = min(0.0, self._dual.of(aim, mixed, unit * self._weight * dual.pull))
        self._told.append((value, least))
        return value + least / self.floor

    def above(self, mass: float) -> float:
        """Return the largest of the bounds for masses of at least the given one."""
        return max((value + least / mass for value, least in self._told), default=-np.inf)


class BoundFinder:
    """Least values of many quantities over one slice, by a solver as in `steelyard.conic.solve`."""

    def __init__(self, center: AnalyticCenter, solver: str) -> None:
        self.center = center
        self.solver = solver
        self.dual = SliceBound(center)
        count = len(center.point)
        first, second = center.ball
        ball = Ball(first, second, np.zeros(count)) if len(first) else None
        self._search = Search(NormalisedProblem(center.groups, ball, count, solver))
        self._found: dict[bytes, Bound] = {}
        self._ratios: dict[bytes, tuple[Search, Matrix]] = {}

    @property
    def trace_bound(self) -> float:
        """The proofs hold for parameters whose traces of all blocks (kg, kg m², ...) add up to less than this."""
        return self.dual.trace_bound

    def least(self, row: Vector) -> Bound:
        """The least value of row · δ, for a row (n,)."""
        key = row.tobytes()
        if key not in self._found:
            self._found[key] = self._least(row)
        return self._found[key]

    def _least(self, row: Vector) -> Bound:
        slice_, center = self.center.slice, self.center
        value = float(row @ center.parameters)
        if slice_.is_identifiable(row):
            return Bound(value - self._rounding(row), value, center.parameters)
        if not slice_.is_constrained(row):
            return UNBOUNDED
        objective = center.directions.T @ row
        found = self._search.least(objective, lambda dual, _: self.dual.of(row, dual.matrices, dual.pull) - value)
        if found.proved == -np.inf or found.point is None:
            return UNBOUNDED
        step = center.directions @ found.point
        parameters = self._contained(lambda share: center.parameters + share * step)
        attained = float(row @ parameters)
        return Bound(min(value + found.proved, attained - self._rounding(row)), attained, parameters)

    def least_ratio(self, row: Vector, mass: Vector, moments: Sequence[Vector]) -> Bound:
        """The least value of (row · δ) / (mass · δ), where the mass is positive in the whole slice.

        Parameters
        ----------
        row, mass : (n,)
        moments : sequence of (n,)
            Combinations, such as moments of inertia, with (row · δ)² ≤ (moment · δ) (mass · δ) in the whole set.
        """
        slice_, center = self.center.slice, self.center
        if not slice_.is_constrained(row):
            return UNBOUNDED
        weight = float(mass @ center.parameters)
        ratio = float(row @ center.parameters) / weight
        rates = center.directions.T @ mass
        objective = center.directions.T @ (row - ratio * mass)
        lightest = max(self.least(mass).proved, 0.0)
        floor = max(lightest, SMALLEST_MASS * weight)
        if float(np.linalg.norm(objective)) <= 1e-12 * float(np.abs(row) @ np.abs(center.directions).sum(axis=1)):
            return Bound(ratio - self._rounding(row) / floor, ratio, center.parameters)
        search, units = self._ratio_search(mass, rates, weight)
        own = units.T @ objective
        proof = RatioProof(self, row, mass, floor)
        found = search.least(own, proof)
        if found.point is None:
            return UNBOUNDED
        point = units @ found.point
        attained, proved = float(objective @ point), found.proved
        if lightest < floor:
            # If the mass may nearly vanish, a bound for masses above the floor proves nothing of a value that is
            # attained at a smaller one: a centre of mass may be as far away as one over the root of that mass.
            inverse = (1.0 - float(rates @ point)) / weight
            below = proof.above(max(1.0 / max(inverse, 1.0 / floor), lightest))
            if attained - below > WIDE_AT_NO_MASS * max(float(np.linalg.norm(own)), -attained):
                proved = -np.inf
        proved += ratio
        if not ratio + attained - proved <= WIDE_RATIO * abs(ratio + attained):
            proved = max(proved, self._plain_ratio(row, mass, moments))
        if proved == -np.inf:
            return UNBOUNDED
        step, growth = weight * (center.directions @ point), float(rates @ point)
        parameters = self._contained(lambda share: center.parameters + share * step / (1.0 - share * growth))
        attained = float(row @ parameters) / float(mass @ parameters)
        return Bound(min(proved, attained - self._rounding(row) / floor), attained, parameters)

    def _plain_ratio(self, row: Vector, mass: Vector, moments: Sequence[Vector]) -> float:
        """A lower bound of a ratio from the bounds of its parts, which is tighter if the mass may vary a lot."""
        numerator, lightest, heaviest = self.least(row).proved, self.least(mass).proved, -self.least(-mass).proved
        if lightest <= 0:
            return 0.0 if numerator >= 0 else -np.inf
        largest = min((-self.least(-moment).proved for moment in moments), default=np.inf)
        return max(numerator / (heaviest if numerator >= 0 else lightest), -float(np.sqrt(largest / lightest)))

    def _ratio_search(self, mass: Vector, rates: Vector, weight: float) -> tuple[Search, Matrix]:
        """The problem in (τ, τ δ) around the center, where τ = (1 - rates · v) / weight, and its own units of v."""
        key = mass.tobytes()
        if key not in self._ratios:
            center = self.center
            positive = BlockGroup(1, np.array([-1]), np.ones((1, 1, 1)), -rates[None, :, None, None])
            groups = [
                BlockGroup(
                    group.size,
                    group.indices,
                    group.constants,
                    weight * group.coefficients - rates[None, :, None, None] * np.eye(group.size),
                )
                for group in center.groups
            ]
            first, second = center.ball
            ball = Ball(first, weight * second - np.outer(first, rates), -rates) if len(first) else None
            problem, units = NormalisedProblem((positive, *groups), ball, len(rates), self.solver).rounded()
            self._ratios[key] = Search(problem), units
        return self._ratios[key]

    def _contained(self, parameters_at: Callable[[float], Vector]) -> Vector:
        """Parameters on the way from the center (0) to a point (1), as far as their eigenvalues come out positive."""
        feasible_set = self.center.slice.feasible_set
        for back in (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5):
            parameters = parameters_at(1.0 - back)
            if np.all(feasible_set.stack.smallest_eigenvalues(parameters) >= 0.0):
                return parameters
        return self.center.parameters

    def mass_duals(self, mass: Vector) -> tuple[Matrix, ...]:
        """Z of each group with Σ <D_b, Z_b> = mass · δ, in the units of the center; zero where no block says so."""
        feasible_set, found, told = self.center.slice.feasible_set, [], False
        for group, inverse in zip(self.center.groups, self.center.factors, strict=True):
            matrices = np.zeros(group.constants.shape)
            for position, index in enumerate(group.indices):
                block = feasible_set.blocks[index]
                diagonal = np.zeros((block.size, len(mass)))
                diagonal[:, block.indices] = np.diagonal(block.coefficients, axis1=1, axis2=2).T
                same = np.flatnonzero(np.all(diagonal == mass, axis=1) & (np.diagonal(block.constant) == 0))
                if len(same) and not told:
                    root = np.linalg.inv(inverse[position])[same]
                    matrices[position] = root.T @ root / len(same)
                    told = True
            found.append(matrices)
        return tuple(found)

    def _rounding(self, row: Vector) -> float:
        return EPSILON * float(np.abs(row) @ np.abs(self.center.parameters))


@dataclass(frozen=True, eq=False)
class Given:
    """The base parameters that are given, and the search for bounds over the slice that they leave.

    Attributes
    ----------
    finder : BoundFinder
    base : (n_b,)
    confidence : float or None
        Probability of the confidence region; None for a point.
    distance : float
        Distance of the estimate from the set, relative to the size of the region; 0 if it is feasible.
    """

    finder: BoundFinder = field(repr=False)
    base: Vector = field(repr=False)
    confidence: float | None
    distance: float


def given_by(
    feasible_set: FeasibleSet,
    base: npt.ArrayLike | None,
    info: Any,
    covariance: npt.ArrayLike | ParameterCovariance | None,
    weights: Any,
    confidence: float,
    solver: str,
) -> Given:
    """The point or confidence region of base parameters that the arguments of `parameter_intervals` describe."""
    region = region_of(feasible_set, base, info, covariance, weights, confidence)
    return given_base(feasible_set, base, solver) if region is None else given_region(feasible_set, region, solver)


def given_base(feasible_set: FeasibleSet, base: npt.ArrayLike | None, solver: str) -> Given:
    """The slice for base parameters that are known exactly.

    Raises
    ------
    InputError
        If no physically possible robot has them.
    NoInteriorError
        If the parameters behind them are a set without an interior, or cannot be told from one.
    """
    if base is None:
        raise InputError("neither base= nor info= was given; give base parameters or data of the robot.")
    beta = feasible_set.as_base(base)
    start = _witness(feasible_set, beta)
    return Given(_finder(Slice.of(feasible_set, beta), start, solver), beta, None, 0.0)


def given_region(feasible_set: FeasibleSet, region: ConfidenceRegion, solver: str) -> Given:
    """The slice for base parameters within a confidence region.

    Raises
    ------
    InputError
        If no feasible parameters lie within it.
    NoInteriorError
        If the parameters behind them are a set without an interior.
    """
    nearest = nearest_in_region(feasible_set, region.base, region.axes, region.unknown, solver)
    relative = nearest.distance / region.radius
    if relative >= 1.0:
        needed = region.probability(nearest.distance)
        wider = f" (it takes the region of {100 * needed:.4g} %)" if needed < 1 - 1e-6 else ""
        raise InputError(
            f"no physically possible robot lies within the {100 * region.confidence:g} % region of the estimate: the "
            f"nearest one lies {relative:.3g} times as far away as its edge{wider}; where rows were taken for "
            "independent ones, give the Information of the samples with its batch_means, which tell how alike "
            f"neighbouring errors are, otherwise a covariance= that is at least {_above(relative**2):g} times as large."
        )
    slice_ = Slice.of(feasible_set, region.base, region.radius * region.axes, region.unknown)
    start = light_point(feasible_set, region.base, region.axes, region.unknown, nearest, region.radius, solver)
    outside = relative if relative > 1e-3 else 0.0
    return Given(_finder(slice_, start, solver), region.base, region.confidence, outside)


def _witness(feasible_set: FeasibleSet, base: Vector) -> Vector:
    """Parameters of the set with K δ = β."""
    verdict = check(feasible_set, base=base)
    if verdict.feasible and verdict.parameters is not None:
        return np.asarray(verdict.parameters)
    if verdict.feasible is None:
        raise NoInteriorError(
            "these base parameters are closer to the boundary of what is possible than can be told (margin "
            f"{verdict.margin:.3g}), which leaves no interval to search; take those of `correct` or `fit`."
        )
    raise InputError(
        f"no physically possible robot has these base parameters (largest margin {verdict.margin:.3g} under "
        f'"{feasible_set.consistency}" consistency), so that no interval exists; take those of `correct` or `fit`, or '
        "give the data as info=, so that the confidence region of the estimate is searched."
    )


def _finder(slice_: Slice, start: Vector, solver: str) -> BoundFinder:
    try:
        center = analytic_center(slice_, slice_.coordinates(start))
    except np.linalg.LinAlgError:
        raise NoInteriorError(
            "the parameters that these base parameters leave possible are a set without an interior, as for links "
            "without extent; give base parameters a little further inside, such as those of `correct` with a larger "
            "margin."
        ) from None
    return BoundFinder(center, solver)


def _above(value: float) -> float:
    """The number with two digits, rounded up."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.ceil(value / step + 1e-9) * step, 12)
