"""Recession directions: whether masses may grow without bound while the base parameters stay the same."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from steelyard.conic import Cone, ConicProblem, Rows, solve

from .cone_program import Conditions
from .constraints import TotalMass
from .feasible_set import FeasibleSet
from .units import Units

__all__ = ["growing_links", "mass_bound_of"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

DIRECTION_BOUND = 1e3
"""Largest element of a direction, in units of the parameters. Along longer ones rounding errors of the conditions would
look like growth."""

ACCURACY = 1e-6
"""Of the search for directions, in which a mass is 0 or 1: where they are as long as `DIRECTION_BOUND`, a mass is known
to 0.001. For a WAM, where many directions are as good, 1e-8 was not reached within all the attempts of the solver."""

MASS_BOUND = 1000.0
"""Bound on the total mass, in kg, if masses may grow without bound and no mass is known: more than most robots
weigh."""

BOUND_FACTORS = (10.0, 50.0)
"""The bound is at least and at most this many times the mass that would explain the torques."""

KNOWN_FACTOR, SPOKEN_FACTOR = 20.0, 2.0
"""If a mass is known, the bound is the first factor times that mass, but at least the second factor times the mass that
would explain the torques, since descriptions may be wrong."""


def growing_links(feasible_set: FeasibleSet, unidentifiable: Matrix | None = None) -> tuple[int, ...]:
    """Links whose masses may grow without bound while the base parameters, conditions and equations still hold.

    A direction d with K d = 0 and E d = 0 whose homogeneous matrices D_b(d) are all positive semidefinite leads from
    every feasible point to feasible points, at any distance. Such directions form a cone. So of those with masses of at
    most 1, the one with the largest sum of masses has a mass in every link in which any of them has.

    Parameters
    ----------
    feasible_set : FeasibleSet
    unidentifiable : (n_b, u), optional
        Directions of the base parameters that the data does not determine; they count as unidentifiable too.

    Returns
    -------
    tuple of int
        Indices of links; empty where no mass may. Kept for each set where `unidentifiable` is absent.
    """
    if unidentifiable is not None and unidentifiable.shape[1]:
        return _analyse(feasible_set, np.hstack([feasible_set.lift @ unidentifiable, feasible_set.unidentifiable]))
    return feasible_set.kept(_growing_whatever_the_data)


def mass_bound_of(feasible_set: FeasibleSet, scale: Units) -> float:
    """The mass bound in kg, well above the mass in the description, in the constraints, and from the torques."""
    cad = np.asarray(feasible_set.model.robot.parameters, dtype=float)[feasible_set.mass_indices]
    known = [float(cad.sum())] if np.all(np.isfinite(cad)) and np.all(cad > 0) else []
    for constraint in feasible_set.constraints:
        if isinstance(constraint, TotalMass):
            known += [value for value in (constraint.minimum, constraint.equal) if value is not None]
    if known:
        return max(KNOWN_FACTOR * max(known), SPOKEN_FACTOR * scale.total_mass)
    least, most = (factor * scale.total_mass for factor in BOUND_FACTORS)
    return float(np.clip(MASS_BOUND, least, most))


def _growing_whatever_the_data(feasible_set: FeasibleSet) -> tuple[int, ...]:
    return _analyse(feasible_set, feasible_set.unidentifiable)


def _analyse(feasible_set: FeasibleSet, directions: Matrix) -> tuple[int, ...]:
    masses = feasible_set.mass_indices
    if not np.any(directions[masses]):
        return ()
    units = Units.of(feasible_set).parameters
    sizes = np.abs(directions / units[:, None]).max(axis=0)
    directions = directions / np.where(sizes > 0, sizes, 1.0)
    conditions = Conditions(feasible_set, directions)
    links, count = len(masses), directions.shape[1]
    scaled = sparse.csc_array(conditions.rows.multiply(conditions.row_factors(units)[:, None]))
    box = directions / units[:, None]
    # Unknowns beside the direction: for each mass the smaller of it and 1, whose sum is maximised.
    counted = sparse.vstack(
        [
            sparse.hstack([sparse.csc_array(-directions[masses] / units[masses, None]), sparse.eye_array(links)]),
            sparse.hstack([sparse.csc_array((links, count)), sparse.eye_array(links)]),
            sparse.hstack([sparse.csc_array(np.vstack([box, -box])), sparse.csc_array((2 * len(box), links))]),
        ]
    )
    most = np.concatenate([np.zeros(links), np.ones(links), np.full(2 * len(box), DIRECTION_BOUND)])
    problem = ConicProblem.from_rows(
        np.concatenate([np.zeros(count), -np.ones(links)]),
        [
            Rows(scaled, np.zeros(scaled.shape[0]), *conditions.cones),
            Rows(sparse.csc_array(counted), most, Cone("nonnegative", len(most))),
        ],
    )
    problem = replace(problem, degenerate=True)  # of directions along which masses grow many are as good
    solution = solve(problem, ACCURACY).require("find which masses may grow without end")
    return tuple(np.flatnonzero(solution.primal[count:] > 0.1).tolist())
