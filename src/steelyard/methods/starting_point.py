"""Where the nonlinear methods start: parameters known before, or least squares, made possible link by link."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.linalg

from .method import Problem

__all__ = ["inertial_of_pseudo_inertia", "pseudo_inertia", "starting_point"]

Array = npt.NDArray[np.float64]

ROWS, COLUMNS = np.triu_indices(3)
PLACES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
INSIDE = 1e-2
"""Eigenvalues of the starting pseudo-inertias are at least this part of their mean, in units of the link."""

GYRATION2 = 0.1
"""Second moment of the default body in each direction, in units of the link's mass and squared length."""


def pseudo_inertia(inertial: Array) -> Array:
    """``[[½ tr(L) 1 - L, l], [lᵀ, m]]`` of every link, (links, 4, 4), of (links, 10) (Wensing et al. 2018)."""
    tensor = inertial[:, PLACES]
    found = np.empty((len(inertial), 4, 4))
    found[:, :3, :3] = 0.5 * np.trace(tensor, axis1=1, axis2=2)[:, None, None] * np.eye(3) - tensor
    found[:, :3, 3] = found[:, 3, :3] = inertial[:, 6:9]
    found[:, 3, 3] = inertial[:, 9]
    return found


def inertial_of_pseudo_inertia(matrices: Array) -> Array:
    """The inverse of `pseudo_inertia`: (links, 10) of (links, 4, 4)."""
    second = matrices[:, :3, :3]
    tensor = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    return np.concatenate([tensor[:, ROWS, COLUMNS], matrices[:, :3, 3], matrices[:, 3, 3:]], axis=1)


def starting_point(problem: Problem, prior: Array | None = None) -> Array:
    """Standard parameters strictly inside the conditions of links and terms, (n,).

    The prior, where there is one and where it is known; otherwise the parameters nearest to bodies of the robot's
    typical mass and size that explain the data as least squares do. Links that are not possible then have the
    eigenvalues of their pseudo-inertia raised, in units of the link.

    Parameters
    ----------
    problem : Problem
    prior : (n,), optional
        NaN where unknown.
    """
    units = problem.units.parameters
    typical = np.zeros(problem.feasible.parameter_count)
    body = inertial_of_pseudo_inertia(np.diag([GYRATION2, GYRATION2, GYRATION2, 1.0])[None])[0]
    typical[problem.links] = problem.units.inertial * body
    typical[problem.others] = np.where(np.isfinite(problem.lower_bounds[problem.others]), units[problem.others], 0.0)
    start = _with_base(problem, typical, units) if prior is None else np.where(np.isnan(prior), typical, prior)
    scaled = start[problem.links] / problem.units.inertial
    values, vectors = np.linalg.eigh(pseudo_inertia(scaled))
    least = INSIDE * np.maximum(np.abs(values).mean(axis=1, keepdims=True), INSIDE)
    raised = np.einsum("kij,kj,klj->kil", vectors, np.maximum(values, least), vectors)
    outside = values[:, 0] < least[:, 0]
    scaled[outside] = inertial_of_pseudo_inertia(raised)[outside]
    start[problem.links] = scaled * problem.units.inertial
    bounds = problem.lower_bounds
    floor = np.where(np.isfinite(bounds), bounds + INSIDE * units, -np.inf)
    start[problem.others] = np.maximum(start, floor)[problem.others]
    return np.asarray(start)


def _with_base(problem: Problem, parameters: Array, units: Array) -> Array:
    """The parameters nearest to these, in their units, that have the base parameters of plain least squares."""
    K = problem.feasible.K * units
    missing = problem.least_squares - problem.feasible.K @ parameters
    step = K.T @ scipy.linalg.solve(K @ K.T, missing, assume_a="pos", check_finite=False)
    return np.asarray(parameters + units * step)
