"""Confidence regions of base parameters."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from steelyard.errors import InputError
from steelyard.files import read_number
from steelyard.regression import Information, ParameterCovariance
from steelyard.regression.factor import solve

from ..feasible_set import FeasibleSet, reduced_regression

__all__ = ["ConfidenceRegion", "region_of"]

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConfidenceRegion:
    """All β = base + radius axes u + unknown v with ‖u‖ ≤ 1: an ellipsoid, or a cylinder if data does not determine β.

    Attributes
    ----------
    base : (n_b,)
    covariance : ParameterCovariance
        Of the estimate: its `root` are the axes, its `unidentifiable` the combinations v that the data leaves open.
    confidence : float
        Probability that the region contains the true β.
    """

    base: Vector = field(repr=False)
    covariance: ParameterCovariance = field(repr=False)
    confidence: float

    def __post_init__(self) -> None:
        expected = "a probability between 0 and 1, such as 0.95"
        read_number(self.confidence, "confidence", expected, above=0, below=1)

    @property
    def axes(self) -> Matrix:
        """(n_b, r), a square root of the covariance: axes axesᵀ."""
        return self.covariance.root

    @property
    def unknown(self) -> Matrix:
        """(n_b, n_b - r), the combinations that the data does not determine."""
        return self.covariance.unidentifiable

    @property
    def radius(self) -> float:
        """Square root of the quantile of the χ² distribution, with one degree of freedom for each axis."""
        from scipy.special import gammaincinv

        return float(np.sqrt(2.0 * gammaincinv(max(self.axes.shape[1], 1) / 2.0, self.confidence)))

    def probability(self, distance: float) -> float:
        """Probability of the region with this radius, in standard deviations."""
        from scipy.special import gammainc

        return float(gammainc(max(self.axes.shape[1], 1) / 2.0, distance**2 / 2.0))


def region_of(
    feasible_set: FeasibleSet,
    base: npt.ArrayLike | None,
    info: Any,
    covariance: npt.ArrayLike | ParameterCovariance | None,
    weights: Any = "joint",
    confidence: float = 0.95,
) -> ConfidenceRegion | None:
    """The region that follows from data or a covariance; None if neither is given.

    Raises
    ------
    InputError
        If both are given, something does not fit, or the torques were filtered, so that no region is valid.
    """
    if info is not None and covariance is not None:
        raise InputError("info= and covariance= both tell how certain the estimate is; give only one of them.")
    if info is not None:
        reduced = reduced_regression(info, weights, feasible_set)
        beta = solve(reduced) if base is None else feasible_set.as_base(base)
        if isinstance(info, Information):
            found = ParameterCovariance.of(info, beta, weights)
        else:
            found = ParameterCovariance.of_reduced(reduced, beta)
    elif covariance is not None:
        if base is None:
            raise InputError("covariance= needs the estimate that it belongs to; give base= too.")
        beta = feasible_set.as_base(base)
        if isinstance(covariance, ParameterCovariance):
            found = covariance
        else:
            found = ParameterCovariance.of_matrix(covariance, len(beta))
    else:
        return None
    if found.filtered_torque:
        raise InputError(
            "the torques of this data were filtered and the regressor was not, so that the estimate is off by more "
            "than noise explains and no confidence region holds; process the log with the model, which filters both, "
            "leave out `torque_cutoff` and `decimate`, or give base= alone."
        )
    return ConfidenceRegion(beta, found, confidence)
