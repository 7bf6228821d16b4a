"""From an estimate to the search for what it leaves possible: a section of the feasible set, around its middle."""

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError, SolverError

from ..check import check
from ..feasible_set import FeasibleSet
from ..nearest_point import light_point, nearest_in_region
from .analytic_center import middle_of
from .bound_finder import BoundFinder
from .confidence_region import ConfidenceRegion
from .slice import Section

__all__ = ["Given", "given_base", "given_region"]

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Given:
    """What is known of the base parameters, and the search for bounds over what they leave possible.

    Attributes
    ----------
    finder : BoundFinder
    base : (n_b,)
    confidence : float or None
        Of the region; None for a point.
    distance : float
        How far outside the set the estimate is, in units of the region; 0 where it is feasible.
    """

    finder: BoundFinder = field(repr=False)
    base: Vector = field(repr=False)
    confidence: float | None
    distance: float


def given_base(feasible: FeasibleSet, base: npt.ArrayLike | None, solver: str) -> Given:
    """The base parameters are known exactly.

    Raises
    ------
    InputError
        If no physically possible robot has them.
    SolverError
        If the parameters behind them are a set without an inside.
    """
    if base is None:
        raise InputError("nothing is given of the robot; give its base parameters as base=, or data as information=.")
    beta = feasible.as_base(base)
    start = _witness(feasible, beta)
    return Given(_finder(Section.of(feasible, beta), start, solver), beta, None, 0.0)


def given_region(feasible: FeasibleSet, region: ConfidenceRegion, solver: str) -> Given:
    """The base parameters lie within a confidence region.

    Raises
    ------
    InputError
        If no feasible parameters lie within it.
    SolverError
        If the parameters behind them are a set without an inside.
    """
    nearest = nearest_in_region(feasible, region.base, region.axes, region.unknown, solver)
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
    section = Section.of(feasible, region.base, region.radius * region.axes, region.unknown)
    start = light_point(feasible, region.base, region.axes, region.unknown, nearest, region.radius, solver)
    outside = relative if relative > 1e-3 else 0.0
    return Given(_finder(section, start, solver), region.base, region.confidence, outside)


def _witness(feasible: FeasibleSet, base: Vector) -> Vector:
    """Parameters of the set with K δ = β."""
    verdict = check(feasible, base=base)
    if verdict.feasible and verdict.parameters is not None:
        return np.asarray(verdict.parameters)
    if verdict.feasible is None:
        raise InputError(
            "these base parameters are closer to the boundary of what is possible than can be told (margin "
            f"{verdict.margin:.3g}), which leaves no interval to search; take those of `correct` or `fit`."
        )
    raise InputError(
        f"no physically possible robot has these base parameters (largest margin {verdict.margin:.3g} under "
        f'"{feasible.consistency}" consistency), so that no interval exists; take those of `correct` or `fit`, or '
        "give the data as information=, so that the confidence region of the estimate is searched."
    )


def _finder(section: Section, start: Vector, solver: str) -> BoundFinder:
    try:
        middle = middle_of(section, section.coordinates(start))
    except np.linalg.LinAlgError:
        raise SolverError(
            "the parameters that these base parameters leave possible are a set without an inside, as for links "
            "without extent; give base parameters a little further inside, such as those of `correct` with a larger "
            "margin."
        ) from None
    return BoundFinder(middle, solver)


def _above(value: float) -> float:
    """Two digits, rounded up."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.ceil(value / step + 1e-9) * step, 12)
