"""Ends of intervals of many quantities at once: what noise, unidentifiable directions and physics leave possible."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.files import tell
from steelyard.lmi import AffineBlock
from steelyard.regression import ParameterCovariance

from ..barrier import Barrier, damped, minimise, newton_step
from ..feasible_set import FeasibleSet
from .confidence_region import ConfidenceRegion
from .quantities import Quantity

__all__ = ["ProfileIntervals", "profile_intervals"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

OUTWARD = 0.02
"""Part of the half-width by which ends are moved outward: what following the path no further leaves uncertain."""

ENOUGH = 0.04
"""Part of the half-width that is left of the way along the central path, from where the rest is extrapolated."""

ACCURACY = 0.02
"""Relative accuracy of the way to the end of a ratio."""

FAR = 1e3
"""Bound of the traces of all blocks, and of what has none, relative to the estimate: the region needs an end. An end
that comes within `OPEN` of it is told as infinite."""

OPEN = 0.02

GROWTH = 50.0
"""Factor of t from one point of the central path to the next: 5 and 50 take more steps."""

FIRST = 3.0
"""t at the beginning, in units of the inverse width of the Dikin ellipsoid."""

STEPS = 150

ROUNDS = 12
"""At most, for a ratio. Three are usual; where a mass has no bound, up to nine."""

CENTERED = 0.05
"""Half the Newton decrement, squared, below which a point counts as one of the central path."""

MOST_DISTANCE = 1e-2
"""Factor of the barrier while the most likely feasible parameters are looked for: it lifts their χ² by as much as this
times the rows of all blocks, less than 1, and so widens intervals by less than an eighth."""


@dataclass(frozen=True, eq=False)
class ProfileIntervals:
    """Intervals of quantities.

    Attributes
    ----------
    lower, upper : (k,)
        Infinite where nothing bounds the quantity.
    chi_squared : float
        Squared distance, in standard deviations, from the estimate of least squares to the most likely feasible
        parameters; with the number of base parameters that the data determines it is of their size, where all is well.
    most_likely : (n,)
        These parameters.
    """

    lower: Vector
    upper: Vector
    chi_squared: float
    most_likely: Vector = field(repr=False)


def profile_intervals(
    feasible_set: FeasibleSet,
    base: npt.ArrayLike,
    covariance: ParameterCovariance,
    quantities: Sequence[Quantity],
    inside: npt.ArrayLike,
    confidence: float = 0.95,
) -> ProfileIntervals:
    """For each quantity the interval that holds the true value with a given probability, each by itself.

    These are the values that the quantity has among all feasible parameters whose χ² is above that of the most likely
    feasible ones by at most the quantile of the distribution with one degree of freedom: intervals of profile
    likelihood (Venzon and Moolgavkar, Applied Statistics 37, 1988; Raue et al., Bioinformatics 25, 2009, for
    unidentifiable parameters). A quantity that neither data nor physics confine has infinite ends; a prior has no part
    in them. `parameter_intervals` tells the same for all parameters together, with proofs, at a hundred times the cost.

    Parameters
    ----------
    feasible_set : FeasibleSet
    base : (n_b,)
        Of plain least squares.
    covariance : ParameterCovariance
        Of this estimate.
    quantities : sequence of Quantity
    inside : (n,)
        Parameters inside the set, such as those of a fit.
    confidence : float

    Returns
    -------
    ProfileIntervals
        Ends lie outside those of the interval by at most 5 % of its half-width; those of ratios (centres of mass) to
        about as much on either side.

    Raises
    ------
    InputError
        If torques were filtered and the regressor was not, so that no interval holds, or `inside` is not inside.
    """
    from scipy.special import gammaincinv

    if covariance.filtered_torque:
        raise InputError(
            "the torques of this data were filtered and the regressor was not, so that the estimate is off by more "
            "than noise explains and no interval holds; process the log with the model, which filters both, or leave "
            "out `torque_cutoff` and `decimate`."
        )
    region = ConfidenceRegion(np.asarray(base, dtype=float), covariance, confidence)
    start = feasible_set.as_parameters(inside)
    barrier = Barrier(feasible_set, _far_blocks(feasible_set, start))
    if not np.isfinite(barrier.value(start[None])[0]):
        raise InputError("profile_intervals needs parameters inside the feasible set to start from.")
    basis = feasible_set.equation_directions
    distance = _Distance(feasible_set, region)
    likely = minimise(_MostLikely(distance, barrier), start[None], basis, 1e-4)[0]
    chi_squared = float(distance.squares(likely[None])[0])
    inner = _Region(distance, barrier, chi_squared + 2.0 * float(gammaincinv(0.5, confidence)))
    center = minimise(inner, likely[None], basis, 1e-3)[0]
    lower, upper = _ends(inner, center, quantities, basis)
    reach = OPEN * _reach(feasible_set, start)
    for index, quantity in enumerate(quantities):
        if quantity.mass is None:
            far_away = float(np.abs(quantity.row) @ reach)
            upper[index] = np.inf if upper[index] > far_away else upper[index]
            lower[index] = -np.inf if lower[index] < -far_away else lower[index]
        if quantity.never_negative:
            lower[index] = max(lower[index], 0.0)
    return ProfileIntervals(lower, upper, chi_squared, likely)


def _far_blocks(feasible_set: FeasibleSet, parameters: Vector) -> tuple[AffineBlock, ...]:
    """Blocks that bound every parameter far from an estimate, so that the region has an end everywhere."""
    places = {int(index): place for own in feasible_set.link_columns for place, index in enumerate(own)}
    found = []
    for index, far in enumerate(_reach(feasible_set, parameters)):
        place = places.get(index)
        # The conditions of a link bound its other elements by its moments and its mass.
        signs = (1.0, -1.0) if place is None else (-1.0,) if place in (0, 3, 5, 9) else ()
        for sign in signs:
            found.append(AffineBlock("far away", np.array([[far]]), np.array([index]), np.array([[[sign]]])))
    return tuple(found)


def _reach(feasible_set: FeasibleSet, parameters: Vector) -> Vector:
    """How far each parameter may go."""
    links = feasible_set.link_columns
    terms = np.setdiff1d(np.arange(len(parameters)), links)
    found = np.full(len(parameters), FAR * max(1.0, float(np.abs(parameters[terms]).max(initial=0.0))))
    # All links together: an estimate may have hardly any mass in the one that the motion does not show.
    mass, moments = parameters[links[:, 9]].sum(), parameters[links[:, [0, 3, 5]]].sum()
    found[links[:, :6]], found[links[:, 9]] = FAR * moments, FAR * mass
    found[links[:, 6:9]] = FAR * np.sqrt(mass * moments)
    return found


class _Distance:
    """The squared distance ‖S δ - s‖² from least squares, in standard deviations."""

    def __init__(self, feasible_set: FeasibleSet, region: ConfidenceRegion) -> None:
        root = region.in_deviations()
        self.rows, self.target = root @ feasible_set.K, root @ region.base
        self.curvature, self.slope = self.rows.T @ self.rows, self.rows.T @ self.target
        self.constant = float(self.target @ self.target)

    def squares(self, points: Matrix) -> Vector:
        errors = points @ self.rows.T - self.target
        return np.asarray(np.einsum("pr,pr->p", errors, errors))


class _MostLikely:
    """The squared distance, with a barrier that hardly counts."""

    def __init__(self, distance: _Distance, barrier: Barrier) -> None:
        self.distance, self.barrier = distance, barrier

    def value(self, points: Matrix, problems: Indices) -> Vector:
        return self.distance.squares(points) + MOST_DISTANCE * self.barrier.value(points)

    def derivatives(self, points: Matrix, problems: Indices) -> tuple[Matrix, npt.NDArray[np.float64]]:
        gradients = 2.0 * (points @ self.distance.curvature - self.distance.slope)
        hessians = np.tile(2.0 * self.distance.curvature, (len(points), 1, 1))
        self.barrier.add_derivatives(points, np.full(len(points), MOST_DISTANCE), gradients, hessians)
        return gradients, hessians


class _Region:
    """The barrier of the feasible parameters within a squared distance, less t times a row of each problem."""

    def __init__(self, distance: _Distance, barrier: Barrier, limit: float) -> None:
        self.distance, self.barrier, self.limit = distance, barrier, limit
        size = barrier.size
        self.rows, self.pull = np.zeros((1, size)), np.zeros(1)

    @property
    def degree(self) -> int:
        return self.barrier.degree + 1

    def value(self, points: Matrix, problems: Indices) -> Vector:
        rest = self.limit - self.distance.squares(points)
        own = np.where(rest > 0, -np.log(np.where(rest > 0, rest, 1.0)), np.inf)
        along = np.einsum("pi,pi->p", self.rows[problems], points)
        return np.asarray(own + self.barrier.value(points) - self.pull[problems] * along)

    def derivatives(self, points: Matrix, problems: Indices) -> tuple[Matrix, npt.NDArray[np.float64]]:
        rest = self.limit - self.distance.squares(points)
        slopes = 2.0 * (points @ self.distance.curvature - self.distance.slope) / rest[:, None]
        hessians = slopes[:, :, None] * slopes[:, None, :]
        for hessian, factor in zip(hessians, 2.0 / rest, strict=True):
            hessian += factor * self.distance.curvature  # one at a time stays in the cache
        gradients = slopes - self.pull[problems, None] * self.rows[problems]
        self.barrier.add_derivatives(points, np.ones(len(points)), gradients, hessians)
        return gradients, hessians


def _ends(
    region: _Region, center: Vector, quantities: Sequence[Quantity], basis: Matrix | None
) -> tuple[Vector, Vector]:
    """Lower and upper ends; those of a ratio by a sequence of linear combinations.

    The largest r / w is the ρ at which the largest r - ρ w is zero; each next ρ is the ratio where that is largest
    (W. Dinkelbach, On nonlinear fractional programming, Management Science 13, 1967).
    """
    rows = np.array([quantity.row for quantity in quantities])
    masses = np.array([np.zeros(len(center)) if q.mass is None else q.mass for q in quantities])
    is_ratio = np.array([quantity.mass is not None for quantity in quantities])
    signs = np.repeat([-1.0, 1.0], len(rows))
    both, weights = np.concatenate([-rows, rows]), np.concatenate([masses, masses])
    turned = np.concatenate([is_ratio, is_ratio])
    denominators = np.where(turned[:, None], weights, 0.0)
    at_center = np.where(turned, (both @ center) / np.where(turned, weights @ center, 1.0), 0.0)
    points, found = _furthest(region, center, both - at_center[:, None] * denominators, basis, denominators)
    active, ratios = np.flatnonzero(turned), at_center.copy()
    points = points[active]
    for _ in range(ROUNDS if len(active) else 0):
        reached = _ratios(both[active], weights[active], points)
        better = np.maximum(reached, ratios[active])
        way, further = better - at_center[active], better - ratios[active]
        ratios[active] = better
        # What is left of the way is less than the last step, which the accuracy covers.
        found[active] = better + ACCURACY * way
        active = active[further > ACCURACY * way]
        if not len(active):
            break
        towards = both[active] - ratios[active, None] * weights[active]
        points, _ = _furthest(region, center, towards, basis, weights[active])
    count = len(rows)
    return signs[:count] * found[:count], found[count:]


def _ratios(rows: Matrix, weights: Matrix, points: Matrix) -> Vector:
    return np.asarray(np.einsum("pi,pi->p", rows, points) / np.einsum("pi,pi->p", weights, points))


def _furthest(
    region: _Region, center: Vector, rows: Matrix, basis: Matrix | None, masses: Matrix
) -> tuple[Matrix, Vector]:
    """For each row (p, n), a point of the region far along it, and what no point of the region exceeds.

    Rows of ratios have masses that are not zero. How far their points are to go is told by the mass there: measured by
    that of the center, which may be many times as much, a row would seem to have arrived long before its ratio has.
    """
    count = len(rows)
    everything = np.arange(count)
    region.rows, region.pull = np.zeros((count, len(center))), np.zeros(count)
    _, hessians = region.derivatives(center[None], np.zeros(1, dtype=np.intp))
    inverse = _inverse(hessians[0], basis)
    steps = rows @ inverse
    widths = np.sqrt(np.maximum(np.einsum("pi,pi->p", steps, rows), 0.0))
    fixed = widths <= 1e-12 * np.abs(rows) @ np.abs(center)  # the equations alone tell these
    widths[fixed] = 1.0
    # Nine tenths of the way to the end of the ellipsoid that lies within the region around its center.
    # Rounding may put them outside where nothing else bounds the region: they are brought nearer.
    region.rows, region.pull = rows, FIRST / widths
    way = np.where(fixed[:, None], 0.0, 0.9 * steps / widths[:, None])
    points = _ahead(region, np.tile(center, (count, 1)), everything, way)
    first, central = rows @ center, masses @ center
    active = everything[~fixed]
    found = first.copy()
    values = region.value(points, everything)
    for _ in range(STEPS):
        if not len(active):
            break
        tell("ends of intervals", count - len(active), count, "ends")
        step, decrease, solved = newton_step(region, points[active], active, basis, rows[active, None])
        along = solved[:, 0]
        points[active], values[active] = damped(region, points[active], active, values[active], step, decrease)
        near = np.flatnonzero(0.5 * decrease <= CENTERED)
        if not len(near):
            continue
        # On the central path rows·x = end - a / t, with a the number of conditions that stop it: t² rows·H⁻¹rows.
        which, pull = active[near], region.pull[active[near]]
        slope = np.einsum("pi,pi->p", rows[which], along[near])
        reached = np.einsum("pi,pi->p", rows[which], points[which])
        lighter = np.ones(len(which))
        turned = central[which] != 0.0
        lighter[turned] = (np.einsum("pi,pi->p", masses[which], points[which])[turned]) / central[which[turned]]
        half = np.maximum(reached + pull * slope - lighter * first[which], lighter * widths[which])
        rest = pull * slope / half
        found[which] = reached + pull * slope + OUTWARD * half
        onward = np.flatnonzero(rest > ENOUGH)
        which, pull = which[onward], pull[onward]
        region.pull[which] = further = pull * np.minimum(GROWTH, 1.5 * rest[onward] / ENOUGH)
        # The next point of the path is this far ahead along its tangent.
        ahead = (pull * (1.0 - pull / further))[:, None] * along[near][onward]
        points[which] = _ahead(region, points[which], which, ahead)
        values[which] = region.value(points[which], which)
        active = np.setdiff1d(active, np.setdiff1d(active[near], which), assume_unique=True)
    return points, found


def _ahead(region: _Region, points: Matrix, problems: Indices, steps: Matrix) -> Matrix:
    """Points a step ahead, which is shortened until it ends in the region, and left out where it never does."""
    found = points + steps
    for _ in range(30):
        outside = ~np.isfinite(region.value(found, problems))
        if not outside.any():
            return np.asarray(found)
        steps[outside] *= 0.7
        found[outside] = points[outside] + 0.9 * steps[outside]
    outside = ~np.isfinite(region.value(found, problems))
    found[outside] = points[outside]
    return np.asarray(found)


def _inverse(hessian: Matrix, basis: Matrix | None) -> Matrix:
    if basis is not None:
        return np.asarray(basis @ _inverse(basis.T @ hessian @ basis, None) @ basis.T)
    sizes = np.sqrt(np.diagonal(hessian))
    return np.asarray(np.linalg.inv(hessian / np.outer(sizes, sizes)) / np.outer(sizes, sizes))
