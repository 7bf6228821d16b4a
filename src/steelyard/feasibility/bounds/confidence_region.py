"""What an estimate leaves possible of the base parameters: its confidence region."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError

from ..feasible_set import FeasibleSet
from ..protocols import ReducedLike

__all__ = ["ConfidenceRegion", "reduced_regression", "region_of"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]

SINGULAR = 1e-9
"""Combinations that the data shows less than this part of what it shows best, columns scaled, are not determined."""


@dataclass(frozen=True, eq=False)
class ConfidenceRegion:
    """All β = base + radius axes u + unknown v with ‖u‖ ≤ 1: an ellipsoid, or a cylinder where data leaves β open.

    Attributes
    ----------
    base : (n_b,)
    axes : (n_b, r)
        A square root of the covariance: axes axesᵀ.
    unknown : (n_b, n_b - r)
        Combinations that the data does not determine.
    deviation : (n_b,)
        Standard deviations, infinite where not determined.
    confidence : float
        Probability with which the region holds the true β.
    noise_factor : float
        By which the axes are longer than independent noise makes them.
    """

    base: Vector = field(repr=False)
    axes: Matrix = field(repr=False)
    unknown: Matrix = field(repr=False)
    deviation: Vector = field(repr=False)
    confidence: float
    noise_factor: float = 1.0

    def widened(self, factor: float) -> "ConfidenceRegion":
        """The region of standard deviations that are larger by a factor."""
        if isinstance(factor, bool) or not isinstance(factor, (int, float)) or not 0 < factor < np.inf:
            raise InputError(f"noise_factor must be a positive number, such as 1.0, got {factor!r}.")
        return replace(
            self,
            axes=factor * self.axes,
            deviation=factor * self.deviation,
            noise_factor=float(factor) * self.noise_factor,
        )

    def in_deviations(self) -> Matrix:
        """The map from a change of β to u, (r, n_b): its squared norm is the squared distance."""
        both = np.linalg.pinv(np.hstack([self.axes, self.unknown]))
        return np.asarray(both[: self.axes.shape[1]])

    @property
    def radius(self) -> float:
        """Root of the quantile of the χ² distribution with as many degrees of freedom as β has determined ones."""
        from scipy.special import gammaincinv

        return float(np.sqrt(2.0 * gammaincinv(max(self.axes.shape[1], 1) / 2.0, self.confidence)))

    def probability(self, distance: float) -> float:
        """Probability of the region that reaches this far, in standard deviations."""
        from scipy.special import gammainc

        return float(gammainc(max(self.axes.shape[1], 1) / 2.0, distance**2 / 2.0))

    @classmethod
    def of_covariance(
        cls, feasible: FeasibleSet, base: npt.ArrayLike, covariance: npt.ArrayLike, confidence: float
    ) -> "ConfidenceRegion":
        """From the covariance of the estimate, (n_b, n_b).

        Raises
        ------
        InputError
            If it is not a covariance matrix of these base parameters.
        """
        beta, matrix = feasible.as_base(base), np.asarray(covariance, dtype=float)
        count = len(beta)
        if matrix.shape != (count, count) or not np.all(np.isfinite(matrix)):
            raise InputError(
                f"covariance must be a matrix of {count} x {count} finite numbers, one row for each base parameter, "
                f"got an array of shape {matrix.shape}; use information= where some base parameters are not determined."
            )
        size = np.sqrt(np.abs(np.diagonal(matrix)))
        scale = np.where(size > 0, size, 1.0)
        scaled = matrix / np.outer(scale, scale)
        if not np.allclose(scaled, scaled.T, rtol=0.0, atol=1e-8):
            raise InputError("covariance must be symmetric; give the covariance matrix of the base parameters.")
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        if values[0] < -1e-9 * max(values[-1], 1.0):
            raise InputError(
                f"covariance must be positive semidefinite, but its smallest eigenvalue (unit variances) is "
                f"{values[0]:.3g}; give the covariance matrix of the base parameters."
            )
        kept = values > 1e-14 * max(values[-1], 0.0)
        axes = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        return cls(beta, axes, np.zeros((count, 0)), size, _as_confidence(confidence))

    @classmethod
    def of_data(
        cls, feasible: FeasibleSet, reduced: ReducedLike, base: npt.ArrayLike | None, confidence: float
    ) -> "ConfidenceRegion":
        """From a reduced regression: the covariance is that of least squares with its residual variance (thesis 4.27).

        Parameters
        ----------
        feasible : FeasibleSet
        reduced : Reduced
        base : (n_b,), optional
            The estimate; least squares where absent.
        confidence : float
        """
        R, rho = np.asarray(reduced.R, dtype=float), np.asarray(reduced.rho, dtype=float)
        count = feasible.K.shape[0]
        lengths = np.linalg.norm(R, axis=0)
        scale = np.where(lengths > 0, lengths, 1.0)
        left, values, rows = np.linalg.svd(R / scale)
        rank = int(np.sum(values > SINGULAR * values.max(initial=0.0)))
        if base is None:
            beta = rows[:rank].T @ ((left[:, :rank].T @ rho) / values[:rank]) / scale
        else:
            beta = feasible.as_base(base)
        error = R @ beta - rho
        variance = (float(error @ error) + float(reduced.residual2)) / max(int(reduced.count) - count, 1)
        axes = np.sqrt(variance) * (rows[:rank].T / values[:rank]) / scale[:, None]
        unknown = rows[rank:].T / scale[:, None]
        deviation = np.linalg.norm(axes, axis=1)
        open_ = np.linalg.norm(unknown * scale[:, None], axis=1) > 1e-6
        deviation = np.where(open_, np.inf, deviation)
        return cls(beta, axes, unknown, deviation, _as_confidence(confidence))


def region_of(
    feasible: FeasibleSet,
    base: npt.ArrayLike | None,
    information: Any,
    covariance: npt.ArrayLike | None,
    weights: Any = "joint",
    confidence: float = 0.95,
    noise_factor: float = 1.0,
) -> ConfidenceRegion | None:
    """The region that data or a covariance tells of; None where neither is given.

    Raises
    ------
    InputError
        If both are given, or something does not fit.
    """
    if information is not None and covariance is not None:
        raise InputError("information= and covariance= both tell how certain the estimate is; give only one of them.")
    if information is not None:
        found = ConfidenceRegion.of_data(feasible, reduced_regression(information, weights, feasible), base, confidence)
    elif covariance is not None:
        if base is None:
            raise InputError("covariance= needs the estimate that it belongs to; give base= too.")
        found = ConfidenceRegion.of_covariance(feasible, base, covariance, confidence)
    else:
        return None
    return found.widened(noise_factor)


def reduced_regression(data: Any, weights: Any, feasible: FeasibleSet) -> ReducedLike:
    """The reduced regression of an Information, or what already is one.

    Raises
    ------
    InputError
        If it is of another model or holds no usable numbers.
    """
    reduced = data.reduced(weights) if hasattr(data, "reduced") else data
    missing = [name for name in ("R", "rho", "residual2", "count", "norm2") if not hasattr(reduced, name)]
    if missing:
        raise InputError(f"information must be an Information (or its reduced form), got {data!r}.")
    R, rho = np.asarray(reduced.R, dtype=float), np.asarray(reduced.rho, dtype=float)
    count = feasible.K.shape[0]
    if R.ndim != 2 or R.shape[1] != count or rho.shape != (R.shape[0],):
        raise InputError(
            f"the data belongs to another model: its reduced regression has R of shape {R.shape}, but the feasible "
            f"set is of a model with {count} base parameters; use the Information of the same model."
        )
    if not (np.all(np.isfinite(R)) and np.all(np.isfinite(rho)) and reduced.norm2 > 0):
        raise InputError("the data holds no usable samples: its torques are all zero or not finite numbers.")
    found: ReducedLike = reduced
    return found


def _as_confidence(confidence: float) -> float:
    if isinstance(confidence, bool) or not isinstance(confidence, (int, float)) or not 0 < confidence < 1:
        raise InputError(f"confidence must be a probability between 0 and 1, such as 0.95, got {confidence!r}.")
    return float(confidence)
