"""Linear regression with automatic relevance determination, from a reduced regression."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.linalg

from steelyard.regression import column_lengths

from .method import Problem

__all__ = ["relevance_regression"]

Vector = npt.NDArray[np.float64]

VAGUE = 1e-8
"""Shape and rate of all gamma priors: they say next to nothing."""


def relevance_regression(problem: Problem, iterations: int, tolerance: float) -> tuple[Vector, int]:
    """Posterior mean of the base parameters, each with a zero-mean normal prior whose precision is learned.

    Variational Bayes with gamma priors on the precisions of parameters and noise. The columns of the regressor are
    scaled to length √rows first, so that all priors mean the same.

    Parameters
    ----------
    problem : Problem
    iterations : int
        Most rounds.
    tolerance : float
        They end where the prediction changes by less than this part of the noise.

    Returns
    -------
    (n_b,), int
        And how many rounds there were.
    """
    rows = max(problem.information.count, 1)
    lengths = column_lengths(problem.R) / np.sqrt(rows)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    R = problem.R / scale
    gram, right = R.T @ R, R.T @ problem.rho
    mean = problem.least_squares * scale
    floor = 1e-14 * problem.norm2
    noise = rows / max(problem.residual2, floor)
    relevance = 1.0 / np.maximum(mean**2, 1e-12 * np.max(mean**2, initial=1e-300))
    rounds = 0
    while rounds < iterations:
        rounds += 1
        precision = noise * gram + np.diag(relevance)
        factor = scipy.linalg.cho_factor(precision, check_finite=False)
        previous, mean = mean, scipy.linalg.cho_solve(factor, noise * right, check_finite=False)
        covariance = scipy.linalg.cho_solve(factor, np.eye(len(mean)), check_finite=False)
        relevance = (2.0 * VAGUE + 1.0) / (2.0 * VAGUE + mean**2 + np.diag(covariance))
        error = R @ mean - problem.rho
        unexplained = max(problem.residual2 + float(error @ error) + float(np.sum(gram * covariance)), floor)
        noise = (2.0 * VAGUE + rows) / (2.0 * VAGUE + unexplained)
        if np.linalg.norm(R @ (mean - previous)) <= tolerance * np.sqrt(unexplained):
            break
    return np.asarray(mean / scale), rounds
