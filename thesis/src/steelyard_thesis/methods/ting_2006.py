"""Ting, Mistry, Peters, Schaal and Nakanishi 2006: Bayesian regression, then the nearest feasible parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import scipy.linalg

from steelyard.regression import column_lengths

from .factored_fit import FactoredFit
from .factored_method import FactoredMethod
from .method import Problem, Progress, require_positive
from .parametrisations import CholeskyOfBody

__all__ = ["Ting2006", "relevance_regression"]


@dataclass(frozen=True)
class Ting2006(FactoredMethod):
    """Bayesian regression without regard to physics, then the nearest parameters that Cholesky factors give.

    First a base estimate by linear regression with automatic relevance determination; then the θ whose δ predicts most
    nearly the same (thesis 2.70 to 2.73), where δ consists, for each link, of m = θ1², l = m (θ2, θ3, θ4) and
    L = m (|r|² 1 - r rᵀ) + F Fᵀ with r = l / m and a lower triangular F of θ5 to θ10. Terms that must not be negative
    are squares, as friction is in the papers. The papers' regression also models noise of each input, which a reduced
    regression no longer tells apart; here the noise is that of the torques alone.

    Known flaws: those of `Nakanishi2008`; and relevance determination shrinks what it thinks irrelevant, so that the
    answer is not the one of least residual.

    Attributes
    ----------
    solver : {"newton", "gauss-newton", "levenberg-marquardt"}
        The papers name none. ``"newton"`` has exact second derivatives and the damping of Levenberg and Marquardt; it
        needs the fewest and cheapest steps. The others are SciPy's least squares.
    iterations : int
        Limit.
    tolerance : float
        On the gradient, in units of the squared residual of least squares.

    relevance_iterations : int
        Limit for the first step.
    relevance_tolerance : float
        The first step ends where its prediction changes by less than this part of the noise.

    References
    ----------
    J.-A. Ting, M. Mistry, J. Peters, S. Schaal, J. Nakanishi, "A Bayesian approach to nonlinear parameter
    identification for rigid body dynamics", Robotics: Science and Systems II, 2006.

    J.-A. Ting, A. D'Souza, S. Schaal, "Bayesian robot system identification with input and output noise", Neural
    Networks 24(1), 2011.

    Examples
    --------
    >>> import numpy as np
    >>> import steelyard as sy
    >>> model = sy.Model(sy.Robot.from_dh([("0", 0.0, 0.0, "q")], gravity=(0, -9.81, 0)))
    >>> names = model.base_parameters().names
    >>> info = sy.Information.from_factor(10 * np.eye(3), [6.0, 5.0, 1.0], 0.02, 100, names)
    >>> estimate = Ting2006().fit(info, sy.FeasibleSet(model, "inertia"))
    >>> estimate.base.round(4).tolist(), estimate.consistency
    ([0.6, 0.5, 0.1], 'inertia')
    """

    name: ClassVar[str] = "Ting et al. 2006"
    source: ClassVar[str] = (
        "J.-A. Ting, M. Mistry, J. Peters, S. Schaal, J. Nakanishi, A Bayesian approach to nonlinear parameter "
        "identification for rigid body dynamics, Robotics: Science and Systems II, 2006"
    )

    relevance_iterations: int = 100
    relevance_tolerance: float = 1e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "relevance_iterations", "relevance_tolerance")

    def _descent(self, problem: Problem, progress: Progress | None) -> FactoredFit:
        base, rounds = relevance_regression(problem, self.relevance_iterations, self.relevance_tolerance)
        if progress is not None:
            progress(f"relevance determination: {rounds} rounds")
        return FactoredFit(problem, CholeskyOfBody(), problem.R @ base)


Vector = npt.NDArray[np.float64]

VAGUE = 1e-8
"""Shape and rate of all gamma priors, so small that the priors hardly influence the result."""


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
        The mean, and the number of rounds.
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
