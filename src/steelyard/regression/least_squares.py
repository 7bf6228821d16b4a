"""Ordinary and joint-weighted least squares with their uncertainty (thesis section 4.4)."""

from __future__ import annotations

from numpy.typing import ArrayLike

from steelyard.errors import InputError

from .estimate import Estimate
from .factor import solve
from .information import Information
from .parameter_covariance import ParameterCovariance

__all__ = ["least_squares", "method_name"]


def least_squares(info: Information, weights: str | ArrayLike | None = "joint") -> Estimate:
    """Estimate the base parameters without regard to physics.

    Parameters
    ----------
    info : Information
    weights : "joint", None or array_like
        ``"joint"`` weights each joint by the inverse standard deviation of its residual (thesis eq. 4.30 to 4.36), and
        is ordinary least squares where the rows of the joints are not known apart; None is ordinary least squares
        (thesis eq. 4.24); an array (N,) gives the weights.

    Returns
    -------
    Estimate
        Its standard errors take into account that residuals are correlated in time, where the Information tells of it.
        Its `parameters` are None, because the regression determines base parameters alone.

    Raises
    ------
    InputError
        Where there is no row at all, or the weights do not fit the joints.

    See Also
    --------
    steelyard.fit : The same, among physically possible parameters.

    References
    ----------
    C. D. Sousa, PhD thesis, University of Coimbra, 2014, eq. 4.24 to 4.36.

    Examples
    --------
    >>> import numpy as np
    >>> info = Information.from_factor(np.diag([2.0, 1.0]), [4.0, 3.0], 0.5, 100, ["a", "b"])
    >>> least_squares(info).base.tolist()
    [2.0, 3.0]
    """
    if info.count < 1:
        raise InputError(
            "The samples hold no usable row, so that nothing can be estimated; check trim, delay, velocity_threshold "
            "and the other options of [processing] that leave rows out, and that joints with presliding friction move "
            "by several of its displacements."
        )
    weighted = info.is_weighted(weights)
    used = info.joint_weights(weights) if weighted else None
    problem = info.reduced(used)
    base = solve(problem)
    remarks = list(info.remarks)
    unidentifiable = info.unidentifiable
    if unidentifiable:
        remarks.append(
            f"The data does not determine {len(unidentifiable)} of {info.base_count} base parameters: "
            f"{'; '.join(unidentifiable)}."
        )
    covariance = ParameterCovariance.of(info, base, used)
    return Estimate(
        method=method_name(info, weighted),
        base_names=info.base_names,
        base_expressions=info.base_expressions,
        base=base,
        standard_error=covariance.standard_error,
        error_correlation=covariance.error_correlation,
        joint_names=info.joint_names,
        weights=used,
        relative_error=info.relative_error(base),
        joint_relative_error=info.joint_relative_error(base) if info.has_joint_errors else None,
        row_count=info.count,
        condition_number=info.condition_number,
        remarks=tuple(remarks),
        filtered_torque=info.filtered_torque,
    )


def method_name(info: Information, weighted: bool) -> str:
    """Return the name of the method: what the rows make of it, or ordinary or weighted least squares."""
    return info.method or ("joint-weighted least squares" if weighted else "ordinary least squares")
