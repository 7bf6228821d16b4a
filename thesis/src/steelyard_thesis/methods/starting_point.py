"""The start of the nonlinear methods: parameters known before, or least squares, made feasible link by link."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.linalg

from steelyard.robot.inertia import parameters_of_pseudo_inertia, pseudo_inertia

from .method import Problem

__all__ = ["starting_point"]

Array = npt.NDArray[np.float64]

INSIDE = 1e-2
"""Eigenvalues of the starting pseudo-inertias are at least this part of their mean, in units of the link."""

GYRATION2 = 0.1
"""Second moment of the default body in each direction, in units of the link's mass and squared length."""


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
    typical = np.zeros(problem.feasible_set.parameter_count)
    body = parameters_of_pseudo_inertia(np.diag([GYRATION2, GYRATION2, GYRATION2, 1.0]))
    typical[problem.links] = problem.units.inertial * body
    typical[problem.others] = np.where(np.isfinite(problem.lower_bounds[problem.others]), units[problem.others], 0.0)
    start = _with_base(problem, typical, units) if prior is None else np.where(np.isnan(prior), typical, prior)
    scaled = start[problem.links] / problem.units.inertial
    values, vectors = np.linalg.eigh(pseudo_inertia(scaled))
    least = INSIDE * np.maximum(np.abs(values).mean(axis=1, keepdims=True), INSIDE)
    raised = np.einsum("kij,kj,klj->kil", vectors, np.maximum(values, least), vectors)
    outside = values[:, 0] < least[:, 0]
    scaled[outside] = parameters_of_pseudo_inertia(raised)[outside]
    start[problem.links] = scaled * problem.units.inertial
    bounds = problem.lower_bounds
    floor = np.where(np.isfinite(bounds), bounds + INSIDE * units, -np.inf)
    start[problem.others] = np.maximum(start, floor)[problem.others]
    return np.asarray(start)


def _with_base(problem: Problem, parameters: Array, units: Array) -> Array:
    """The parameters nearest to these, in their units, that have the base parameters of plain least squares."""
    K = problem.feasible_set.K * units
    missing = problem.least_squares - problem.feasible_set.K @ parameters
    step = K.T @ scipy.linalg.solve(K @ K.T, missing, assume_a="pos", check_finite=False)
    return np.asarray(parameters + units * step)
